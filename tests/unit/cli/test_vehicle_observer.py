"""When a command to a vehicle counts as carried out, and how the result reads."""

import math

import msgspec
import pytest
from tests.unit.cli.sights import HOLDING, UP, sight

from swarmctl.vehicles.observer import EndedResult, ManoeuvreProgress, VehicleResult, raise_failures
from swarmctl.vehicles.selection import stations_left
from swarmctl.vehicles.snapshot import BUILT_IN, VehicleSnapshot, arrived_at, risen_to
from swarmware.errors import NoAnswer, Partial, SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.navigation import NavState, NavStatus
from swarmware.types.vehicle import Pose, VehicleState

S = 1_000_000_000


def run(epoch: int, state: str) -> MissionState:
    return MissionState(epoch, "00112233", MissionPhase(state))


@pytest.mark.parametrize(
    ("states", "chosen", "stations"),
    [
        ({"gcs": run(7, "running"), "uav1": run(7, "running")}, ["uav1", "uav2"], ["gcs"]),
        ({"gcs": run(7, "running"), "uav1": run(7, "running"), "uav2": run(7, "running")}, ["uav1"], []),
        ({"gcs": run(7, "running"), "uav1": run(7, "running"), "uav2": run(7, "done")}, ["uav1"], ["gcs"]),
        ({"gcs": run(7, "running"), "uav1": run(7, "running"), "uav2": run(8, "running")}, ["uav1"], ["gcs"]),
        ({"gcs": run(7, "done"), "uav1": run(7, "running")}, ["uav1"], []),
        ({"gcs": run(0, "idle"), "uav1": run(0, "running")}, ["uav1"], []),
        ({"gcs": run(8, "running"), "uav1": run(7, "running")}, ["uav1"], []),
        ({"uav1": run(7, "running")}, ["uav1"], []),
    ],
)
def test_station_is_ordered_with_missions_last_vehicles(
    states: dict[str, MissionState], chosen: list[str], stations: list[str]
) -> None:
    kinds = {name: PlatformKind("gcs" if name == "gcs" else "uav") for name in ("gcs", "uav1", "uav2")}
    assert list(stations_left(states, kinds, chosen)) == stations


@pytest.mark.parametrize(
    ("command", "seen", "done"),
    [
        ("land", sight(), True),
        ("land", sight(vehicle=UP), False),
        ("land", sight(vehicle=VehicleState(True, True)), False),
        ("land", sight(vehicle=None), False),
        ("land", sight(kind="ugv", pose=Pose.planar(0, 0, velocity_m_s=(2.0, 0.0, 0.0))), False),
        ("land", sight(kind="ugv"), True),
        ("hold", sight(vehicle=UP), True),
        ("hold", sight(vehicle=UP, pose=None), False),
        ("hold", sight(vehicle=UP, nav=NavStatus(3, NavState.MOVING)), False),
        ("hold", sight(vehicle=UP, pose=Pose.planar(0, 0, 5, velocity_m_s=(2.0, 0.0, 0.0))), False),
        ("hold", sight(), True),
        ("return", sight(home=Pose.planar(1.0, 0.0)), True),
        ("return", sight(home=Pose.planar(9.0, 0.0)), False),
        ("return", sight(vehicle=UP, home=Pose.planar(1.0, 0.0)), False),
    ],
)
def test_what_is_seen_decides_whether_it_is_done(command: str, seen: VehicleSnapshot, done: bool) -> None:
    assert BUILT_IN[command](seen) is done


def test_statements_before_command_prove_nothing() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["land"])
    assert course.verdict(sight(), 5, 0) is None
    assert course.verdict(sight(), 6, 1) is True


def test_a_mission_that_still_plays_is_waited_for() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["land"])
    for state in ("ready", "running", "ending", "recovering"):
        assert course.verdict(sight(state), 6, 100 * S) is None


def test_old_failure_is_not_answer_to_new_command() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["land"])
    up = sight("failed", vehicle=UP)
    assert course.verdict(up, 6, 0) is None
    assert course.verdict(sight("recovering", vehicle=UP), 7, S) is None
    assert course.verdict(sight("done"), 8, 9 * S) is True


def test_vehicle_flying_after_its_mission_has_failed() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["land"])
    up = sight("failed", vehicle=UP)
    assert course.verdict(up, 6, 0) is None
    assert course.verdict(up, 7, 4 * S) is False


def test_states_before_missions_end_are_no_failure() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["hold"])
    moving = msgspec.structs.replace(
        sight("aborted", UP, nav=NavStatus(3, NavState.MOVING)), mission_ns=70 * S, states_ns=69 * S
    )
    assert course.verdict(moving, 6, 0) is None
    repeated = msgspec.structs.replace(moving, mission_ns=74 * S)
    assert course.verdict(repeated, 7, 4 * S) is None
    assert course.verdict(msgspec.structs.replace(repeated, states_ns=71 * S), 7, 5 * S) is False
    assert course.verdict(sight("aborted", vehicle=UP), 7, 5 * S) is True


def test_refused_vehicle_has_failed_with_unchanged_state() -> None:
    course = ManoeuvreProgress(5, risen_to(5.0))
    refused = msgspec.structs.replace(sight("failed"), mission_ns=70 * S, states_ns=9 * S)
    assert course.verdict(refused, 6, 0) is None
    assert course.verdict(refused, 7, 4 * S) is False


def test_a_ground_station_has_only_to_stop() -> None:
    course = ManoeuvreProgress(5, BUILT_IN["land"])
    assert course.verdict(sight("running", vehicle=None, kind="gcs"), 6, 0) is None
    assert course.verdict(sight("aborted", vehicle=None, kind="gcs"), 7, 0) is True


def test_a_vehicle_is_described_as_it_is_seen() -> None:
    assert sight().words() == "landed 0.0 m disarmed"
    high = Pose.planar(0, 0, 8.04)
    assert sight(vehicle=UP, pose=high).words() == "holding 8.0 m armed"
    assert sight(vehicle=UP, pose=high, nav=NavStatus(3, NavState.MOVING)).words() == "flying 8.0 m armed"
    killed = VehicleState(False, False)
    assert sight(vehicle=killed, pose=high).words() == "falling 8.0 m disarmed", "whatever its navigator says"
    assert sight(kind="ugv").words() == "stopped 0.0 m disarmed"
    assert sight(vehicle=None).words() == "unknown"
    assert math.isinf(sight(pose=None).speed_m_s)


def on_circle(state: NavState, x_m: float, y_m: float, z_m: float) -> VehicleSnapshot:
    """An aircraft that keeps its places on circles of 90 m, at 22 m/s."""
    pose = msgspec.structs.replace(Pose.planar(x_m, y_m, z_m), vx_m_s=22.0)
    return sight(vehicle=UP, nav=NavStatus(3, state, circle_m=90.0), pose=pose)


def test_aircraft_arrives_on_circle_around_place() -> None:
    there = arrived_at(100.0, 0.0, 40.0)
    assert there(on_circle(NavState.ARRIVED, 190.0, 0.0, 42.0))
    assert there(on_circle(NavState.ARRIVED, 100.0, -85.0, 38.0))
    assert not there(on_circle(NavState.MOVING, 190.0, 0.0, 40.0)), "it passes by"
    assert not there(on_circle(NavState.ARRIVED, 100.0, 0.0, 40.0))
    assert not there(on_circle(NavState.ARRIVED, 190.0, 0.0, 55.0))
    risen = risen_to(40.0)
    assert risen(on_circle(NavState.ARRIVED, 0.0, 0.0, 38.0))
    assert not risen(on_circle(NavState.ARRIVED, 0.0, 0.0, 35.0))
    assert not risen(on_circle(NavState.MOVING, 0.0, 0.0, 41.0))
    assert BUILT_IN["hold"](on_circle(NavState.HOLDING, 0.0, 0.0, 40.0))
    assert on_circle(NavState.HOLDING, 0.0, 0.0, 40.0).words() == "circling 40.0 m armed"
    assert on_circle(NavState.MOVING, 0.0, 0.0, 40.0).words() == "flying 40.0 m armed"


def test_aircraft_returned_when_beside_its_circle() -> None:
    landed = sight(nav=NavStatus(3, NavState.ARRIVED, circle_m=90.0), pose=Pose.planar(200.0, 0.0))
    home = msgspec.structs.replace(landed, home=Pose.planar(0.0, 0.0))
    assert BUILT_IN["return"](home)
    assert not BUILT_IN["return"](msgspec.structs.replace(home, home=Pose.planar(-300.0, 0.0)))
    assert not BUILT_IN["return"](msgspec.structs.replace(home, nav=HOLDING))


def seen(platform: str, ok: bool, reached: bool = True, text: str = "") -> VehicleResult:
    return VehicleResult(platform, ok, reached, "landed", 1.0, text=text)


@pytest.mark.parametrize(
    ("found", "error"),
    [
        ([seen("a", True), seen("b", False, False, "no answer")], Partial),
        ([seen("a", False, False, "no answer")], NoAnswer),
        ([seen("a", False, True, "not seen to be done within 5 s")], NoAnswer),
        ([seen("a", False, True, "no answer: its session ended")], NoAnswer),
        ([EndedResult("a", False, True, "landed", 1.0, text="land: blocked")], SwarmError),
    ],
)
def test_the_result_is_an_exit_code(found: list[VehicleResult], error: type[SwarmError]) -> None:
    with pytest.raises(error) as raised:
        raise_failures("land", found)
    assert type(raised.value) is error
    raise_failures("land", [seen("a", True)])
