"""A node and a root with keys of a former version, in which not every beacon was signed."""

from pathlib import Path

import pytest
from tests.unit.cli.invitation import Station, inviting_at, plan
from tests.unit.security.former_roster import former

from swarmctl.commands.keys.making import make_root
from swarmctl.membership.joining import join
from swarmware.errors import ConfigError, Conflict
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.root import Root
from swarmware.transport.sodium import SigningKey


def test_former_keys_are_refused_with_replacing_commands(tmp_path: Path) -> None:
    base, vehicle = Station(make_node(tmp_path, "gcs")), Station(make_node(tmp_path, "uav1"))
    root, fresh = tmp_path / "root", tmp_path / "fresh"
    make_root(base, root, "harbour")
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    key = SigningKey((root / "root.key").read_bytes())
    for folder in (root, base.keys_dir, vehicle.keys_dir):
        (folder / "roster.json").write_bytes(former((folder / "roster.json").read_bytes(), key))
    for platform, station in (("gcs", base), ("uav1", vehicle)):
        with pytest.raises(ConfigError, match="swarmctl keys init --replace --root DIR"):
            station.keys(platform)
    with pytest.raises(ConfigError, match="not every beacon is signed"):
        make_root(base, root, "harbour", replace=True)
    with pytest.raises(Conflict, match="--replace to give them up"):
        make_root(base, fresh, "harbour")
    make_root(base, fresh, "harbour", replace=True)
    with inviting_at(base, fresh, plan()) as token:
        join(vehicle, token("uav1"), None, replace=True)
    assert base.keys("gcs").root_public == vehicle.keys("uav1").root_public == Root.load(fresh).public
