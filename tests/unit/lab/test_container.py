"""A container of the lab finds out who it is and writes a configuration that its daemons accept."""

from importlib import import_module
from pathlib import Path

import msgspec
import pytest
import tomli_w

from swarmlab import container
from swarmware.errors import ConfigError
from swarmware.model.config import NodeConfig, parse
from swarmware.model.platform_kind import PlatformKind
from swarmware.transport.security.keys import Keys


def test_each_container_gets_own_stable_name(tmp_path: Path) -> None:
    claims = tmp_path / "claims"
    names = [
        container.claim(PlatformKind.UAV, claims, tmp_path / str(number) / "platform") for number in range(3)
    ]
    assert names == ["uav1", "uav2", "uav3"]
    assert container.claim(PlatformKind.UGV, claims, tmp_path / "ground") == "ugv1"
    assert container.claim(PlatformKind.GCS, claims, tmp_path / "station") == "gcs"
    with pytest.raises(ConfigError, match="all taken"):
        container.claim(PlatformKind.GCS, claims, tmp_path / "second")


def test_returning_container_regains_its_free_name(tmp_path: Path) -> None:
    (tmp_path / "platform").write_text("uav7")
    assert container.claim(PlatformKind.UAV, tmp_path / "claims", tmp_path / "platform") == "uav7"
    (tmp_path / "other").write_text("uav7")
    assert container.claim(PlatformKind.UAV, tmp_path / "claims", tmp_path / "other") == "uav1"


@pytest.mark.parametrize(("name", "kind"), [("gcs", "gcs"), ("ugv1", "ugv"), ("uav2", "uav")])
def test_the_daemons_accept_what_it_writes(name: str, kind: str) -> None:
    for path, content in container.settings(
        name, PlatformKind(kind), "172.18.0.3", "mongodb://mongo:27017"
    ).items():
        cls: type[msgspec.Struct] = NodeConfig
        if path != "node.toml":
            cls = import_module(f"swarmd.{Path(path).stem}.config").Config
        assert isinstance(parse(tomli_w.dumps(content), cls, path), cls)


def test_the_keys_are_made_once_for_all(tmp_path: Path) -> None:
    container.share_keys(tmp_path)
    first = (tmp_path / "uav3").stat().st_ino
    container.share_keys(tmp_path)
    assert (tmp_path / "uav3").stat().st_ino == first
    assert not Keys.load(tmp_path / "ugv1", "ugv1").is_open
