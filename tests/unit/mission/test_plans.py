"""Plans of other tools: every item as its tool flies it, or refused by name."""

import json
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.mission.results import result

from swarmd.mission.core.player import Player
from swarmd.mission.core.run import PlayEnded, PlayResult, StartBlock
from swarmware.errors import MissionError
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Goto
from swarmware.mission.check import check_folder
from swarmware.mission.field_path import Scalar
from swarmware.mission.finding import sound
from swarmware.mission.folder import from_files
from swarmware.mission.loader import load
from swarmware.mission.plans.conversion import ConvertedPlan, convert
from swarmware.mission.plans.plan import PlannedHome
from swarmware.mission.plans.reader import read_plan
from swarmware.types.mission import MissionFile

DATA = Path(__file__).parents[2] / "data"
REAL = sorted((DATA / "plans").glob("*.plan"))
HOME = "0 1 0 16 0 0 0 0 47.0 8.0 400 1"
UP = "1 0 3 22 0 0 0 0 0 0 10 1"
S = 1_000_000_000


class Nothing:
    """A vehicle of which nothing is known."""

    def value(self, path: str, field: str) -> Scalar | None:
        return None

    def age_s(self, path: str) -> float | None:
        return None


def converted(data: bytes) -> ConvertedPlan:
    plan = read_plan(data, "a.waypoints")
    home = plan.home or PlannedHome(47.0, 8.0, 0.0)
    return convert(plan, home, LocalMap(Origin(lat_deg=home.lat_deg, lon_deg=home.lon_deg)).to_local)


def waypoints(*rows: str, newline: str = "\n") -> ConvertedPlan:
    return converted(newline.join(["QGC WPL 110", HOME, *rows, ""]).encode())


def flown(mission: ConvertedPlan) -> list[tuple[str, Any]]:
    """Blocks that the player of the mission daemon starts, in this order, with their parameters."""
    player = Player(load(mission.text, "m.json", Binding()), Nothing(), lambda: 0.0, count(1))
    found: list[tuple[str, Any]] = []
    actions, now_ns = player.start(0), 0
    for _ in range(10_000):
        started = [action for action in actions if isinstance(action, StartBlock)]
        if any(isinstance(action, PlayEnded) for action in actions):
            assert PlayResult.DONE in [action.result for action in actions if isinstance(action, PlayEnded)]
            return found
        if started:
            found.append((started[0].block.type, started[0].block.params))
            actions = player.on_ended(started[0].token, result("ok"), now_ns)
        else:
            waited_ns = (player.deadline_ns() or 0) - now_ns
            found.append(("Wait", waited_ns / S))
            now_ns += waited_ns
            actions = player.advance(now_ns)
    raise AssertionError("the mission does not end")


def kinds(mission: ConvertedPlan) -> list[str]:
    return [kind for kind, _ in flown(mission)]


def places(mission: ConvertedPlan) -> list[tuple[float, float, float | None]]:
    return [(p.x_m, p.y_m, p.z_m) for _, p in flown(mission) if isinstance(p, Goto)]


def raw_items(node: Any) -> list[dict[str, Any]]:
    """Simple items of a plan by their keys alone, at any depth."""
    if isinstance(node, dict) and node.get("type") == "SimpleItem":
        return [node]
    children = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    return [item for child in children for item in raw_items(child)]


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_real_plan_keeps_its_items_and_commands(path: Path) -> None:
    raw = raw_items(json.loads(path.read_text()))
    items = read_plan(path.read_bytes(), path.name).items
    assert [(i.number, i.command, i.frame) for i in items] == [
        (i["doJumpId"], i["command"], i["frame"]) for i in raw
    ]


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_real_plan_is_flown_in_its_order(path: Path) -> None:
    raw = json.loads(path.read_text())
    lat, lon, _ = raw["mission"]["plannedHomePosition"]
    mission = converted(path.read_bytes())
    local = LocalMap(Origin(lat_deg=lat, lon_deg=lon))
    expected = [local.to_local(*i["params"][4:]) for i in raw_items(raw) if i["command"] == 16]
    assert len(expected) in {3, 8}
    assert [pytest.approx(place, abs=0.002) for place in expected] == places(mission)
    files = [MissionFile("mission.json", mission.text)]
    assert sound(check_folder(from_files(files, "")))


def test_real_plan_names_each_part_it_leaves_out() -> None:
    survey = converted(REAL[1].read_bytes())
    numbers = [part.part.split()[1] for part in survey.unsupported]
    assert numbers == ["1", "3", "5", "10", "13"]
    assert survey.remarks == ("item 2: no take-off before it; the mission climbs to 50 m",)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("gap", [" ", "\t", "  "])
def test_rows_are_read_with_any_separator(newline: str, gap: str) -> None:
    rows = [
        row.replace(" ", gap) for row in (UP, "2 0 3 16 5 0 0 0 47.001 8.0 20 1", "3 0 3 20 0 0 0 0 0 0 0 1")
    ]
    mission = waypoints(*rows, newline=newline)
    assert kinds(mission) == ["Arm", "Takeoff", "Goto", "Wait", "Return", "Land", "Disarm"]
    ((x_m, y_m, z_m),) = places(mission)
    assert (x_m, y_m, z_m) == pytest.approx((0, 111.17, 20), abs=0.1)


@pytest.mark.parametrize(
    ("frame", "lat", "lon", "height"),
    [
        (0, "47.001", "8", 420),
        (3, "47.001", "8", 20),
        (5, "470010000", "80000000", 420),
        (6, "47.001", "8", 20),
    ],
)
def test_each_frame_gives_the_height_above_home(frame: int, lat: str, lon: str, height: int) -> None:
    ((_, y_m, z_m),) = places(waypoints(UP, f"2 0 {frame} 16 0 0 0 0 {lat} {lon} {height} 1"))
    assert (y_m, z_m) == pytest.approx((111.17, 20), abs=0.1)


@pytest.mark.parametrize("frame", [1, 2, 10, 11, 99])
def test_other_frame_is_left_out_by_name(frame: int) -> None:
    mission = waypoints(UP, f"2 0 {frame} 16 0 0 0 0 47.001 8 20 1")
    assert places(mission) == []
    assert [str(part).split(" (")[0] for part in mission.unsupported] == ["item 2"]
    assert f"frame {frame} " in str(mission.unsupported[0])


def test_plan_of_terrain_heights_alone_is_refused() -> None:
    with pytest.raises(MissionError, match=r"nothing to fly[^$]*:3: item 1 .*frame 10 \(terrain\)"):
        converted((DATA / "terrain.waypoints").read_bytes())


def test_jump_repeats_its_items_as_often_as_counted() -> None:
    mission = waypoints(
        UP,
        "2 0 3 16 0 0 0 0 47.001 8 20 1",
        "3 0 3 16 0 0 0 0 47.002 8 20 1",
        "4 0 3 177 2 2 0 0 0 0 0 1",
        "5 0 3 16 0 0 0 0 47.003 8 20 1",
    )
    norths = [round(y_m / 111.17) for _, y_m, _ in places(mission)]
    assert norths == [1, 2, 1, 2, 1, 2, 3]


@pytest.mark.parametrize(("target", "times"), [(9, 1), (2, -1), (2, 1.5)])
def test_jump_that_cannot_be_kept_is_left_out(target: int, times: float) -> None:
    mission = waypoints(UP, "2 0 3 16 0 0 0 0 47.001 8 20 1", f"3 0 3 177 {target} {times} 0 0 0 0 0 1")
    assert len(places(mission)) == 1
    assert "item 3 (command 177, DO_JUMP)" in str(mission.unsupported)


def test_too_many_repeated_items_are_refused() -> None:
    with pytest.raises(MissionError, match=r"a\.waypoints:[45]: item [23]: more than 2000 items"):
        waypoints(UP, "2 0 3 16 0 0 0 0 47.001 8 20 1", "3 0 3 177 2 5000 0 0 0 0 0 1")


def test_speed_heading_and_delays_are_kept() -> None:
    mission = waypoints(
        UP,
        "2 0 3 178 1 4 -1 0 0 0 0 1",
        "3 0 3 19 7 0 0 0 47.001 8 20 1",
        "4 0 3 115 90 0 1 0 0 0 0 1",
        "5 0 3 93 3 0 0 0 0 0 0 1",
        "6 0 3 21 0 0 0 0 47.001 8 0 1",
    )
    assert kinds(mission) == ["Arm", "Takeoff", "Goto", "Wait", "Goto", "Wait", "Goto", "Land", "Disarm"]
    assert [value for kind, value in flown(mission) if kind == "Wait"] == [7, 3]
    gotos = [params for _, params in flown(mission) if isinstance(params, Goto)]
    assert [goto.speed_m_s for goto in gotos] == [4, 4, 4]
    assert [goto.yaw_rad for goto in gotos] == [None, 0.0, None]
    assert gotos[2].z_m is None
    assert mission.unsupported == ()


def test_endless_loiter_ends_the_mission() -> None:
    mission = waypoints(UP, "2 0 3 17 0 0 0 0 47.001 8 20 1", "3 0 3 16 0 0 0 0 47.002 8 20 1")
    assert kinds(mission) == ["Arm", "Takeoff", "Goto"]


@pytest.mark.parametrize("command", [18, 82, 84, 85, 112, 183, 201, 206, 2000, 3000, 31000])
def test_command_without_block_is_left_out_by_name(command: int) -> None:
    mission = waypoints(UP, f"2 0 3 {command} 1 1 0 0 47.001 8 20 1", "3 0 3 16 0 0 0 0 47.001 8 20 1")
    assert len(places(mission)) == 1
    assert str(mission.unsupported[0]).startswith(f"item 2 (command {command}, ")


def test_plan_of_fixed_wing_is_named() -> None:
    raw = json.loads(REAL[0].read_text())
    raw["mission"]["vehicleType"] = 1
    assert converted(json.dumps(raw).encode()).unsupported[0].part == "vehicle type 1"


def test_two_items_of_one_number_are_refused() -> None:
    raw = json.loads(REAL[0].read_text())
    raw["mission"]["items"][3]["doJumpId"] = 2
    with pytest.raises(MissionError, match=r"/mission/items/3: item 2 occurs twice"):
        converted(json.dumps(raw).encode())


def test_fence_and_rally_points_are_named() -> None:
    raw = json.loads(REAL[0].read_text())
    raw["geoFence"]["circles"] = [{"circle": {"center": [47.4, 8.5], "radius": 10}, "inclusion": True}]
    raw["rallyPoints"]["points"] = [[47.4, 8.5, 10]]
    found = [part.part for part in converted(json.dumps(raw).encode()).unsupported]
    assert found[:2] == ["geoFence (1 circles)", "rallyPoints (1 points)"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "unknown format"),
        (b"\xff\xfe", r":1: not UTF-8"),
        (b"QGC WPL 120\n", ":1: "),
        (b"QGC WPL 110\n0\t1\t0\n", ":2: 3 columns; expected 12"),
        (b"QGC WPL 110\n0 1 0 16 0 0 0 x 47 8 10 1\n", ":2: column 8: 'x': expected a number"),
        (b"QGC WPL 110\n0 1 0 16 0 0 0 0 97 8 10 1\n1 0 3 16 0 0 0 0 97 8 1 1", ":3: item 1: 97"),
        (b"QGC WPL 110\n4 1 0 16 0 0 0 0 47 8 10 1\n", ":2: item 4: expected number 0"),
        (b'{"fileType": "Plan"}', "/mission: expected"),
        (b'{"fileType": "Plan",\n"mission": {"items": [\n7]}}', ":3: /mission/items/0: item 1: None"),
        (b"{" * 50_000, "a.waypoints"),
        (b" " * (50 << 20), "more than 1048576 bytes"),
    ],
)
def test_broken_file_is_refused_with_its_place(data: bytes, message: str) -> None:
    with pytest.raises(MissionError, match=message):
        converted(data)


@pytest.mark.parametrize(
    "row", ["3 178 1 1e-300 0 0 0 0 0", "3 16 0 0 0 0 47.001 8 1e12", "3 22 0 0 0 0 0 0 -1"]
)
def test_extreme_value_leaves_a_mission_or_nothing(row: str) -> None:
    mission = waypoints(UP, f"2 0 {row} 1", "3 0 3 16 0 0 0 0 47.001 8 20 1")
    assert "1e-300" not in mission.text


@given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda data: b"QGC WPL 110\n" + data))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(MissionError):
        converted(data)


SOME: st.SearchStrategy[Any] = st.sampled_from(
    [None, 0, 1, -1, 3, 16, 22, 177, 1e300, "x", True, [], {}, 47.4, 8.5]
)


@given(st.data())
def test_changed_plan_is_converted_or_refused(data: st.DataObject) -> None:
    raw = json.loads(REAL[0].read_text())
    for item in raw["mission"]["items"]:
        if data.draw(st.booleans()):
            item[data.draw(st.sampled_from(sorted(item)))] = data.draw(SOME)
        if isinstance(item["params"], list) and data.draw(st.booleans()):
            item["params"] = [*item["params"][:6], data.draw(SOME)]
    try:
        mission = converted(json.dumps(raw).encode())
    except MissionError:
        return
    load(mission.text, "m.json", Binding())
