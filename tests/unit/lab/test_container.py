"""A container of the lab finds out who it is and writes a configuration that its daemons accept."""

from importlib import import_module
from pathlib import Path

import msgspec
import pytest
import tomli_w

from swarmctl.lab import container
from swarmware.config import NodeConfig, parse
from swarmware.errors import ConfigError
from swarmware.security import Keys


@pytest.mark.parametrize(
    ("kind", "host", "name"),
    [
        ("uav", "lab_uav_2.lab_default", "uav2"),
        ("ugv", "my-swarm-ugv-13.my-swarm_default", "ugv13"),
        ("gcs", "lab_gcs_1.lab_default", "gcs"),
    ],
)
def test_the_platform_follows_from_the_name_of_the_container(kind: str, host: str, name: str) -> None:
    assert container.platform(kind, host) == name


def test_a_container_without_a_number_is_refused_with_a_way_out() -> None:
    with pytest.raises(ConfigError, match="SWARM_PLATFORM"):
        container.platform("uav", "0f3a9c")


@pytest.mark.parametrize(("name", "kind"), [("gcs", "gcs"), ("ugv1", "ugv"), ("uav2", "uav")])
def test_the_daemons_accept_what_it_writes(name: str, kind: str) -> None:
    for path, content in container.settings(name, kind, "172.18.0.3", "mongodb://mongo:27017").items():
        cls: type[msgspec.Struct] = NodeConfig
        if path != "node.toml":
            cls = import_module(f"swarmd.{Path(path).stem}.config").Config
        parse(tomli_w.dumps(content), cls, path)


def test_the_keys_are_made_once_for_all(tmp_path: Path) -> None:
    container.share_keys(tmp_path)
    first = (tmp_path / "uav3").stat().st_ino
    container.share_keys(tmp_path)
    assert (tmp_path / "uav3").stat().st_ino == first
    assert not Keys.load(tmp_path / "ugv1", "ugv1").is_open
