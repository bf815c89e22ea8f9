"""Trees of the computers of one platform: each path belongs to one of them, and all are one tree."""

from tests.unit.tree.pair import BATTERY, POSE, TEMPLATE, core, value
from tests.unit.tree.units import Units

from swarmd.tree.core.action import (
    PruneMirrors,
    RemoveMirrors,
    SendNotify,
)
from swarmware.model.resource import Kind, Resource

SPEED = Resource(path="config/speed", kind=Kind.SETTING, type="Float", default=1.0, access="rw")
ROUTES = Resource(path="net/routes", type="Routes", owner="broker")
BEACON_POSE = Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator", link="tick")


def test_main_cedes_units_resource_until_forgotten() -> None:
    main, fc = core("uav1", TEMPLATE), core("uav1.fc", TEMPLATE)
    units = Units(main, fc)
    fc.on_applications([POSE], [], 0)
    assert [item.resource.path for item in fc.local.index] == ["nav/pose"]
    assert "nav/pose" in main.local.index
    units.meet()
    assert "nav/pose" not in main.local.index
    assert BATTERY.path in main.local.index
    units.part("uav1.fc")
    assert "nav/pose" not in main.local.index
    units.wait(601)
    assert "nav/pose" in main.local.index
    assert RemoveMirrors("uav1.fc") in units.removed["uav1"]


def test_unit_gets_others_values_at_platform_path() -> None:
    main, fc = core("uav1", (BEACON_POSE,)), core("uav1.fc", (BEACON_POSE,))
    units = Units(main, fc)
    main.on_applications([], ["nav/pose"], 0)
    fc.on_applications([BEACON_POSE], [], 0)
    units.meet()
    assert main.replicas.wants() == []
    assert fc.subscribers.offers() == []
    for sequence in range(1, 4):
        fc.on_values([value("nav/pose", sequence, sequence)], units.now_ns)
        units.wait(0.05)
    assert units.mirrored["uav1"] == [("uav1", "nav/pose", "fc")] * 3


def test_values_of_one_instant_share_a_notification() -> None:
    main, fc = core("uav1", TEMPLATE), core("uav1.fc", TEMPLATE)
    units = Units(main, fc)
    main.on_applications([], ["nav/pose", "power/battery"], 0)
    fc.on_applications([POSE, BATTERY], [], 0)
    units.meet()
    fc.on_values([value("nav/pose", 1.0), value("power/battery", 0.5)], units.now_ns)
    (sent,) = [action for action in fc.drain() if isinstance(action, SendNotify)]
    assert [item.path for item in sent.notify.items] == ["nav/pose", "power/battery"]


def test_another_platform_subscribes_at_unit_that_provides_board() -> None:
    main, fc, gcs = core("uav1", (BEACON_POSE,)), core("uav1.fc", (BEACON_POSE,)), core("gcs", ())
    units = Units(main, fc, gcs)
    gcs.on_applications([], ["/*/nav/pose"], 0)
    fc.on_applications([BEACON_POSE], [], 0)
    units.meet()
    units.wait(1)
    wants = [(want.platform, want.unit, want.path) for want in gcs.replicas.wants()]
    assert wants == [("uav1", "fc", "nav/pose")]
    assert [offer.path for offer in fc.subscribers.offers()] == ["nav/pose"]


def test_common_resources_are_mains_outside_own_inside() -> None:
    main, fc, gcs = core("uav1"), core("uav1.fc"), core("gcs", ())
    units = Units(main, fc, gcs)
    for tree in (main, fc):
        tree.on_applications([ROUTES], ["net/routes"], 0)
    gcs.on_applications([], ["/uav1/net/routes", "/uav1.fc/net/routes"], 0)
    units.meet()
    units.wait(1)
    for tree in (main, fc):
        tree.on_values([value("net/routes", 1.0)], units.now_ns)
    units.wait(1)
    assert sorted(units.mirrored["gcs"]) == [
        ("uav1", "net/routes", "main"),
        ("uav1.fc", "net/routes", "fc"),
    ]
    assert units.mirrored["uav1"] == units.mirrored["uav1.fc"] == []


def test_moved_application_takes_resource_to_unit() -> None:
    main, fc, gcs = core("uav1", ()), core("uav1.fc", ()), core("gcs", ())
    units = Units(main, fc, gcs)
    main.on_applications([POSE], ["nav/pose"], 0)
    fc.on_applications([], ["nav/pose"], 0)
    gcs.on_applications([], ["/uav1/nav/pose"], 0)
    units.meet()
    place = gcs.replicas.units.leaf("uav1", "nav/pose")
    assert place is not None
    assert place[0] is gcs.replicas.get("uav1")
    main.on_applications([], ["nav/pose"], units.now_ns)
    fc.on_applications([POSE], ["nav/pose"], units.now_ns)
    units.wait(2)
    fc.on_values([value("nav/pose", 1.0)], units.now_ns)
    units.wait(1)
    place = gcs.replicas.units.leaf("uav1", "nav/pose")
    assert place is not None
    assert place[0] is gcs.replicas.get("uav1.fc")
    assert units.mirrored["uav1"] == [("uav1", "nav/pose", "fc")]
    assert PruneMirrors("uav1", frozenset()) in units.removed["uav1.fc"]


def test_value_before_cession_of_path_survives() -> None:
    main, fc, gcs = core("uav1", (BATTERY,)), core("uav1.fc", (BATTERY,)), core("gcs", ())
    units = Units(main, fc, gcs)
    gcs.on_applications([], ["/uav1/power/battery"], 0)
    fc.on_applications([BATTERY], [], 0)
    for one, other in ((gcs, main), (gcs, fc), (fc, gcs), (main, gcs)):  # main and fc have not met
        one.on_up(str(other.address), other.local.version, True, 0)
    units.carry()
    fc.on_values([value("power/battery", 1.0)], 0)
    units.wait(1)
    assert units.mirrored["gcs"] == [("uav1", "power/battery", "fc")]


def test_setting_is_kept_where_application_uses_it() -> None:
    main, fc = core("uav1", (SPEED,)), core("uav1.fc", (SPEED,))
    units = Units(main, fc)
    used = fc.local.setting("config/speed", "navigator")
    assert used is not None
    fc.on_applications([used], [], 0)
    assert main.local.holds("config/speed")
    units.meet()
    assert not main.local.holds("config/speed")
    assert fc.local.holds("config/speed")
    assert fc.local.setting("nav/pose", "navigator") is None
