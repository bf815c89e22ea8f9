"""`swarmctl keys beacons`: whether members sign every beacon, from the making of a swarm on."""

import re
from pathlib import Path

from tests.unit.cli.invitation import Station, inviting_at, plan

from swarmctl.commands.keys.listing import list_members, show_member
from swarmctl.commands.keys.making import make_root
from swarmctl.membership import changing
from swarmctl.membership.joining import join
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.root import Root


def test_a_new_swarm_signs_every_beacon_and_its_root_alone_changes_that(
    tmp_path: Path,
) -> None:
    base, vehicle, root = (
        Station(make_node(tmp_path, "gcs")),
        Station(make_node(tmp_path, "uav1")),
        tmp_path / "root",
    )
    make_root(base, root, "harbour")

    def signs() -> bool:
        roster = base.keys("gcs").roster
        return roster is not None and roster.signs_beacons

    assert signs(), "unless init is told otherwise"
    changing.sign_beacons(base, root, signs=False)
    assert not signs()
    changing.sign_beacons(base, root, signs=False)
    assert "sampled already" in base.stderr.getvalue()
    changing.sign_beacons(base, root, signs=True)
    assert signs()
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    joined = vehicle.keys("uav1").roster
    assert joined is not None and joined.signs_beacons
    show_member(base, None, "gcs")
    assert re.search(r"beacons +signed", base.stdout.getvalue())
    list_members(base, None)
    assert "beacons signed" in base.stdout.getvalue()


def test_an_init_with_sampled_beacons_says_so(tmp_path: Path) -> None:
    vehicle = Station(make_node(tmp_path, "uav1"))
    make_root(vehicle, tmp_path / "own", "harbour", sign_beacons=False)
    assert re.search(r"beacons +sampled", vehicle.stdout.getvalue())
    (vehicle.keys_dir / "node.key").unlink()  # as a kill would leave it
    make_root(vehicle, tmp_path / "own", "harbour")
    assert Root.load(tmp_path / "own").roster.signs_beacons
