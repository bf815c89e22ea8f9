"""Heights, take-off and landing, one motion at a time: what a vehicle that flies must not be told to do."""

import asyncio
from typing import Any

import pytest
from tests.unit.mission.nets import choice, net

from swarmd.mission.blocks.motions import GotoBlock
from swarmware.mission import catalogue
from swarmware.mission.binding import Binding
from swarmware.mission.check import check_folder, check_text
from swarmware.mission.finding import Finding
from swarmware.mission.folder import from_files
from swarmware.mission.plugin import BlockError
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionFile


def go(after: str, **more: Any) -> dict[str, Any]:
    return {"type": "Goto", "x": 5, "y": 0, "next": after, **more}


UP = {"type": "Takeoff", "alt": 5}
HOP = net(s="Start>q", q="Arm>t", t={**UP, "next": "g"}, g=go("l"), l="Land>e", e="End")


def found(text: str, kind: str = "uav") -> list[Finding]:
    return check_text(text, "m.json", Binding(f"{kind}1", PlatformKind(kind)))[1]


def rules(text: str, kind: str = "uav") -> list[tuple[str, str, str]]:
    return [(f.severity, f.rule, f.pointer.removeprefix("/mission/")) for f in found(text, kind)]


def test_up_there_and_down_again_is_sound() -> None:
    assert rules(HOP) == []
    assert rules(HOP.replace('"x": 5', '"x": 5, "z": 8')) == []


@pytest.mark.parametrize("z_m", [-3, 0])
def test_a_height_in_the_ground_is_refused(z_m: float) -> None:
    text = HOP.replace('"x": 5', f'"x": 5, "z": {z_m}')
    assert rules(text) == [("error", "below-ground", "g")]
    assert f"at a height of {z_m} m" in found(text)[0].message


def test_waypoint_in_the_ground_is_refused() -> None:
    way = {"type": "Waypoints", "points": [[1, 2], [3, 4, -1]], "next": "l"}
    text = net(s="Start>q", q="Arm>t", t={**UP, "next": "g"}, g=way, l="Land>e", e="End")
    assert rules(text) == [("error", "below-ground", "g")]


def test_a_ground_vehicle_has_no_height() -> None:
    text = net(s="Start>g", g=go("e", z=0), e="End")
    assert rules(text, "ugv") == []


@pytest.mark.parametrize(
    "text",
    [
        net(s="Start>g", g=go("l"), l="Land>e", e="End"),
        net(
            s="Start>q",
            q="Arm>d",
            d=choice("t", "g"),
            t={**UP, "next": "g"},
            g=go("l"),
            l="Land>e",
            e="End",
        ),
        net(
            s="Start>q",
            q="Arm>t",
            t={**UP, "next": "g", "nextError": "g"},
            g=go("l"),
            l="Land>e",
            e="End",
        ),
        net(s="Start>q", q="Arm>t", t={**UP, "next": "k"}, k="Land>g", g=go("l"), l="Land>e", e="End"),
        net(s="Start>g", g={"type": "Formation", "leader": "ugv1", "next": "l"}, l="Land>e", e="End"),
    ],
    ids=["never", "perhaps not", "it failed", "landed again", "formation"],
)
def test_motion_possible_before_take_off_is_refused(text: str) -> None:
    assert rules(text) == [("error", "not-in-the-air", "g")]
    assert found(text)[0].trace


def test_end_in_air_is_warning_unless_mission_failed() -> None:
    text = net(s="Start>q", q="Arm>t", t={**UP, "next": "e"}, e="End")
    assert rules(text) == [("warning", "ends-in-the-air", "e")]
    failed = net(s="Start>q", q="Arm>t", t={**UP, "next": "e"}, e={"type": "End", "result": "failed"})
    assert rules(failed) == []
    unsure = net(
        s="Start>q",
        q="Arm>t",
        t={**UP, "next": "l"},
        l={"type": "Land", "next": "e", "nextError": "e"},
        e="End",
    )
    assert rules(unsure) == [("warning", "ends-in-the-air", "e")]


@pytest.mark.parametrize("kind", ["uav", "ugv"])
def test_two_motions_at_once_are_one_too_many(kind: str) -> None:
    before = {"q": "Arm>t", "t": {**UP, "next": "f"}} if kind == "uav" else {}
    text = net(
        s="Start>q" if before else "Start>f",
        **before,
        f="Fork>a,b",
        a=go("j"),
        b="Hold>j",
        j="Join>l",
        l="Land>e",
        e="End",
    )
    (finding,) = found(text, kind)
    assert (finding.severity, finding.rule) == ("error", "two-motions")
    assert "'a' and 'b' can move the vehicle at once" in finding.message


@pytest.mark.parametrize(
    ("kinds", "severities"),
    [
        ('["ugv"]', []),
        ('["ugv", "uav"]', ["warning"]),
        ('["uav", "ugv"]', ["warning"]),
        ('["uav"]', ["error"]),
    ],
)
def test_role_for_ground_vehicles_warns_about_flying(kinds: str, severities: list[str]) -> None:
    text = net(s="Start>g", g=go("e"), e="End")
    manifest = f'name = "x"\n[[roles]]\nname = "a"\nfile = "a.json"\nkinds = {kinds}\n'
    files = [MissionFile("mission.toml", manifest), MissionFile("a.json", text)]
    found = check_folder(from_files(files, ""))
    assert [f.severity for f in found if f.rule == "not-in-the-air"] == severities


AFTER = {"t": {**UP, "next": "l"}, "l": "Land>e", "e": "End"}
REFUSED = {"type": "Arm", "next": "t", "nextError": "t"}


@pytest.mark.parametrize(
    ("text", "severity"),
    [
        (net(s="Start>t", **AFTER), "error"),
        (net(s="Start>w", w="Wait>t", **AFTER), "error"),
        (net(s="Start>a", a="Arm>o", o="Disarm>t", **AFTER), "error"),
        (net(s="Start>a", a="Arm>d", d=choice("o", "t"), o="Disarm>t", **AFTER), "warning"),
        (net(s="Start>d", d=choice("a", "t"), a="Arm>t", **AFTER), "warning"),
        (net(s="Start>a", a=REFUSED, **AFTER), "warning"),
        (
            net(s="Start>f", f="Fork>a,t", a="Arm>j", j="Join>l", **AFTER | {"t": {**UP, "next": "j"}}),
            "warning",
        ),
        (net(s="Start>a", a="Arm>t", **AFTER), None),
        (net(s="Start>d", d=choice("a", "b"), a="Arm>t", b="Arm>t", **AFTER), None),
        (net(s="Start>f", f="Fork>a,w", a="Arm>j", w="Wait>j", j="Join>t", **AFTER), None),
    ],
)
def test_a_takeoff_needs_an_arm_before_it(text: str, severity: str | None) -> None:
    found_here = [finding for finding in found(text) if finding.rule == "not-armed"]
    assert [finding.severity for finding in found_here] == ([severity] if severity else [])
    for finding in found_here:
        assert finding.pointer == "/mission/t"
        assert finding.trace[0] == "s"
        assert ("'t' begins with the motors off" in finding.message) == (severity == "error")


def test_mission_requiring_armed_motors_does_not_arm() -> None:
    text = net(s="Start>t", **AFTER)
    assert rules(text[:-1] + ', "requires": ["vehicle/state.armed"]}') == []


@pytest.mark.parametrize(
    ("block", "severity", "words"),
    [
        (go("l", z=5) | {"x": 63_640, "y": 63_640}, "error", "90001 m from the map's origin"),
        (go("l", z=900), "error", "a height of 900 m"),
        (go("l", z=-30), "error", "30 m below the map's origin"),
        (go("l", z=5) | {"x": 45_000}, "warning", "45000 m from the map's origin, near the limit"),
        (go("l", z=450), "warning", "a height of 450 m, near the limit"),
        (go("l", z=5) | {"x": 50_001}, "error", "expected at most 50000 m"),
        ({"type": "Takeoff", "alt": 800, "next": "l"}, "error", "a height of 800 m"),
        (
            {"type": "Formation", "leader": "ugv1", "course": [[0, 0], [90_000, 0]], "next": "l"},
            "error",
            "course[1]: 90000 m",
        ),
        (
            {"type": "Formation", "leader": "ugv1", "offset_m": [0, 0, -40], "next": "l"},
            "error",
            "40 m below",
        ),
        (
            {"type": "Waypoints", "points": [[0, 0], [90_000, 0]], "next": "l"},
            "error",
            "points_m[1]: 90000 m",
        ),
        ({"type": "Waypoints", "points": [[0, 0, 5], [1, 1, 450]], "next": "l"}, "warning", "450 m"),
    ],
)
def test_implausible_position_is_refused_and_near_limit_reported(
    block: dict[str, Any], severity: str, words: str
) -> None:
    text = net(s="Start>q", q="Arm>t", t={**UP, "next": "g"}, g=block, l="Land>e", e="End")
    (finding,) = found(text)
    assert (finding.severity, finding.rule, finding.pointer) == (severity, "implausible", "/mission/g")
    assert words in finding.message


@pytest.mark.parametrize(
    "block", [go("l", z=5) | {"x": 7_900}, go("l", z=390), go("l", z=0.5), {**UP, "alt": 300, "next": "l"}]
)
def test_position_well_within_limits_is_unreported(block: dict[str, Any]) -> None:
    text = net(s="Start>q", q="Arm>t", t={**UP, "next": "g"}, g=block, l="Land>e", e="End")
    assert rules(text) == []


def test_deep_underground_is_error_for_every_vehicle() -> None:
    text = net(s="Start>g", g=go("e", z=-30), e="End")
    assert rules(text, "ugv") == [("error", "implausible", "g")]
    (mixed,) = [
        f for f in check_folder(from_files([MissionFile("m.json", text)], "")) if f.rule == "implausible"
    ]
    assert mixed.severity == "error"


class Vehicle:
    """Takes goals."""

    def __init__(self, height_m: float | None, *, flies: bool = True) -> None:
        self._height_m = height_m
        self.flies = flies
        self.goals: list[dict[str, Any]] = []

    @property
    def height_m(self) -> float:
        if self._height_m is None:
            raise BlockError("no_position", "unknown")
        return self._height_m

    async def goto(self, x_m: float, y_m: float, z_m: float, **fields: Any) -> None:
        self.goals.append({"z_m": z_m, **fields})


class Context:
    def __init__(self, vehicle: Vehicle, params: catalogue.Goto) -> None:
        self.vehicle = vehicle
        self.params = params


@pytest.mark.parametrize(
    ("z_m", "vehicle", "expected"),
    [
        (None, Vehicle(7.5), 7.5),
        (3.0, Vehicle(7.5), 3.0),
        (3.0, Vehicle(None), 3.0),
        (None, Vehicle(None, flies=False), 0.0),
    ],
)
def test_a_goto_without_a_height_keeps_the_height(
    z_m: float | None, vehicle: Vehicle, expected: float
) -> None:
    params = catalogue.Goto(x_m=1, y_m=2, z_m=z_m)
    asyncio.run(GotoBlock().run(Context(vehicle, params)))  # type: ignore[arg-type]  # as much of a context as it needs
    assert [goal["z_m"] for goal in vehicle.goals] == [expected]


def test_package_block_in_air_is_checked_like_goto() -> None:
    spray = catalogue.BlockType("Spray", "Sprays a field.", motion=True, airborne=True)
    catalogued = catalogue.Catalogue((*catalogue.BLOCKS, spray))
    text = net(s="Start>g", g={"type": "Spray", "next": "e"}, e="End")
    _, found = check_text(text, "m.json", Binding(), catalogued)
    assert [finding.rule for finding in found] == ["not-in-the-air"]


def test_goto_without_any_height_fails() -> None:
    vehicle = Vehicle(None)
    with pytest.raises(BlockError) as caught:
        asyncio.run(GotoBlock().run(Context(vehicle, catalogue.Goto(x_m=1, y_m=2))))  # type: ignore[arg-type]  # as above
    assert caught.value.kind == "no_position"
    assert vehicle.goals == []
