"""The navigator: status and set-point for a table of goals and situations."""

import math

import msgspec
import pytest
from tests.unit.navigator.rig import ORIGIN, STEP_NS, Rig

from swarmd.navigator.config import Config
from swarmd.navigator.core.ground_controller import GroundController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.navigation import Goal, GoalKind, NavError
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range, VehicleState

COURSE = ((0.0, 0.0), (50.0, 0.0))


def test_vehicle_without_goal_idles_with_pose() -> None:
    rig = Rig().go(1.0)
    assert rig.status.state == "idle"
    assert rig.last.pose is not None
    assert rig.stands


@pytest.mark.parametrize("kind", ["uav", "ugv"])
def test_goto_arrives(kind: str) -> None:
    rig = Rig(kind).goal(Goal(1, GoalKind.GOTO, 6.0, 2.0, 8.0, speed_m_s=2.0)).go(1.0)
    assert rig.status.state == "moving"
    assert 0 < rig.status.distance_m < 6.4
    rig.go(15.0)
    assert (rig.status.goal_seq, rig.status.state) == (1, "arrived")
    assert math.hypot(rig.truth.x_m - 6.0, rig.truth.y_m - 2.0) < 0.5


@pytest.mark.parametrize("kind", ["uav", "ugv"])
def test_goto_with_a_heading_arrives_with_it(kind: str) -> None:
    rig = Rig(kind).goal(Goal(1, GoalKind.GOTO, 4.0, 0.0, 8.0, yaw_rad=2.0)).go(25.0)
    assert rig.status.state == "arrived"
    assert rig.truth.yaw_rad == pytest.approx(2.0, abs=0.15)


def test_take_off_climbs_straight_with_its_speed() -> None:
    rig = Rig(z_m=0.0)
    rig.vehicle(True, True)
    rig.go(0.5).goal(Goal(3, GoalKind.TAKEOFF, z_m=6.0, speed_m_s=1.0))
    rig.vehicle(True, False)
    rig.go(3.0)
    assert rig.truth.z_m == pytest.approx(3.0, abs=0.2)
    rig.go(8.0)
    assert rig.status.state == "arrived"
    assert rig.truth.z_m == pytest.approx(6.0, abs=0.2)
    assert math.hypot(rig.truth.x_m, rig.truth.y_m) < 0.2


def test_landing_is_over_when_the_vehicle_says_so() -> None:
    rig = Rig().go(0.5).goal(Goal(4, GoalKind.LAND, speed_m_s=1.0)).go(4.0)
    assert rig.status.state == "moving"
    assert rig.truth.z_m == pytest.approx(4.0, abs=0.5)
    rig.go(2.8)
    assert rig.last.setpoint.vz_m_s == pytest.approx(-Config().air.touch_down_m_s, abs=0.05)
    rig.go(3.0)
    rig.vehicle(True, True)
    rig.go(0.2)
    assert rig.status.state == "arrived"
    assert rig.stands


def test_hold_stays_where_the_vehicle_stopped() -> None:
    rig = (
        Rig()
        .goal(Goal(1, GoalKind.GOTO, 50.0, 0.0, 8.0, speed_m_s=3.0))
        .go(5.0)
        .goal(Goal(2, GoalKind.HOLD))
        .go(6.0)
    )
    assert rig.status.state == "holding"
    x = rig.truth.x_m
    rig.go(5.0)
    assert rig.truth.x_m == pytest.approx(x, abs=0.1)


def test_disarmed_vehicle_is_blocked_but_not_at_once() -> None:
    rig = Rig("ugv")
    rig.vehicle(False, True)
    rig.go(0.5).goal(Goal(1, GoalKind.GOTO, 5.0)).go(0.5)
    assert rig.status.state == "moving"
    rig.go(1.0)
    assert (rig.status.state, rig.status.error) == ("blocked", NavError.DISARMED)
    rig.vehicle(True, True)
    rig.go(1.0)
    assert rig.status.state == "moving"


def test_without_a_position_it_holds() -> None:
    rig = Rig().goal(Goal(1, GoalKind.GOTO, 50.0, 0.0, 8.0)).go(2.0)
    rig.gnss = False
    rig.go(1.5)
    assert (rig.status.state, rig.status.error) == ("holding", NavError.NO_POSITION)
    assert rig.stands
    assert rig.last.pose is None
    rig.gnss = True
    rig.go(1.0)
    assert rig.status.state == "moving"


def test_no_progress_is_being_blocked() -> None:
    rig = Rig().goal(Goal(1, GoalKind.GOTO, 50.0, 0.0, 8.0))
    rig.held = True
    rig.go(4.0)
    assert rig.status.state == "moving"
    rig.go(3.0)
    assert (rig.status.state, rig.status.error) == ("blocked", NavError.NO_WAY)
    rig.held = False
    rig.go(2.0)
    assert rig.status.state == "moving"


def test_driving_to_and_fro_is_no_progress() -> None:
    rig = Rig("ugv", "ugv1").goal(Goal(1, GoalKind.GOTO, 50.0, 0.0)).go(1.0)
    rig.held = True
    begin = rig.truth
    for step in range(80):
        phase = math.pi * step / 10
        x_m = begin.x_m + 0.2 * math.sin(phase)
        rig.truth = Pose.planar(x_m, begin.y_m, 0.0, 0.0, (0.2 * math.pi * math.cos(phase), 0.0, 0.0))
        rig.go(0.1)
    assert (rig.status.state, rig.status.error) == ("blocked", NavError.NO_WAY)
    rig.held = False
    rig.go(2.0)
    assert rig.status.state == "moving"


@pytest.mark.parametrize(
    ("goal", "kind", "note"),
    [
        (Goal(1, GoalKind("dance")), "uav", "expected one of hold, goto"),
        (Goal(1, GoalKind.TAKEOFF, z_m=3.0), "ugv", "does not fly"),
        (Goal(1, GoalKind.FORMATION, leader="x", course=((1.0, 1.0),)), "uav", "two different waypoints"),
        (Goal(1, GoalKind.FORMATION, leader="x", advance=True), "uav", "expected a course"),
        (Goal(1, GoalKind.FORMATION, leader="uav1"), "uav", "expected a course"),
    ],
)
def test_senseless_goal_is_blocked_with_reason(goal: Goal, kind: str, note: str) -> None:
    rig = Rig(kind).go(0.5).goal(goal).go(0.5)
    assert rig.status.state == "blocked"
    assert rig.status.error is NavError.BAD_GOAL
    assert note in rig.status.note
    assert rig.stands


def formation(seq: int = 1, *, advance: bool = True, leader: str = "ugv1") -> Goal:
    return Goal(
        seq,
        GoalKind.FORMATION,
        leader=leader,
        offset_m=(-6.0, 3.0, 8.0),
        course=COURSE,
        advance=advance,
        speed_m_s=2.0,
    )


def test_a_follower_takes_its_slot_and_keeps_it() -> None:
    rig = Rig()
    rig.neighbours["ugv1"] = Pose.planar(10.0, 0.0)
    rig.go(0.5).goal(formation(advance=False)).go(15.0)
    assert rig.status.state == "arrived"
    assert (rig.truth.x_m, rig.truth.y_m, rig.truth.z_m) == pytest.approx((4.0, 3.0, 8.0), abs=0.2)
    rig.goal(formation(2)).go(0.2)
    for i in range(200):
        rig.neighbours["ugv1"] = Pose.planar(10.0 + 0.1 * i, 0.0, 0.0, 0.0, (2.0, 0.0, 0.0))
        rig.go(0.05)
    assert rig.truth.x_m == pytest.approx(10.0 + 0.1 * 199 - 6.0, abs=0.3)
    assert rig.status.formation_error_m < 0.3
    assert rig.status.state == "moving"


def test_follower_has_arrived_when_leader_is_at_end() -> None:
    rig = Rig()
    rig.neighbours["ugv1"] = Pose.planar(50.1, 0.1)
    rig.go(0.5).goal(formation()).go(30.0)
    assert rig.status.state == "arrived"


@pytest.mark.parametrize("too_far_m", [0.8, 1.5, 2.5])
@pytest.mark.parametrize("course", [COURSE, ()], ids=["course", "rigid"])
def test_ground_vehicle_that_overshot_its_slot_drives_back(
    too_far_m: float, course: tuple[tuple[float, float], ...]
) -> None:
    rig = Rig("ugv", "ugv2")
    rig.neighbours["ugv1"] = Pose.planar(10.0 - too_far_m, 0.0)
    goal = Goal(1, GoalKind.FORMATION, leader="ugv1", offset_m=(-10.0, 0.0, 0.0), course=course)
    rig.go(0.5).goal(goal).go(15.0)
    assert rig.status.state == "arrived"
    assert rig.truth.x_m == pytest.approx(-too_far_m, abs=0.5)


@pytest.mark.parametrize("beside_m", [0.8, -1.5, 4.0])
@pytest.mark.parametrize("behind_m", [0.0, 1.5, 6.0])
def test_ground_vehicle_beside_its_slot_comes_from_behind(beside_m: float, behind_m: float) -> None:
    rig = Rig("ugv", "ugv2")
    rig.neighbours["ugv1"] = Pose.planar(20.0 - behind_m, 0.0)
    goal = Goal(1, GoalKind.FORMATION, leader="ugv1", offset_m=(-20.0, beside_m, 0.0), course=COURSE)
    rig.go(0.5).goal(goal).go(40.0)
    assert rig.status.state == "arrived"
    assert (rig.truth.x_m, rig.truth.y_m) == pytest.approx((-behind_m, beside_m), abs=0.5)
    assert abs(rig.truth.yaw_rad) < 0.3


def test_lost_leader_is_held_for_and_found_again() -> None:
    rig = Rig()
    rig.neighbours["ugv1"] = Pose.planar(10.0, 0.0)
    rig.go(0.5).goal(formation()).go(3.0)
    del rig.neighbours["ugv1"]
    rig.go(3.0)
    assert (rig.status.error, rig.status.note) == (NavError.LEADER_LOST, "ugv1")
    rig.go(3.0)
    assert rig.stands
    rig.neighbours["ugv1"] = Pose.planar(12.0, 0.0)
    rig.go(1.0)
    assert rig.status.state == "moving"


@pytest.mark.parametrize("kind", ["uav", "ugv"])
def test_leader_drives_course_and_stops_at_its_end(kind: str) -> None:
    rig = Rig(kind, "ugv1")
    goal = msgspec.structs.replace(formation(), offset_m=(0.0, 0.0, 0.0))
    rig.go(0.5).goal(goal).go(5.0)
    assert rig.status.state == "moving"
    assert 35.0 < rig.status.distance_m < 50.0
    rig.go(35.0)
    assert rig.status.state == "arrived"
    assert rig.truth.x_m == pytest.approx(50.0, abs=0.6)
    if kind == "uav":
        assert rig.truth.z_m == pytest.approx(8.0, abs=0.3)


def test_echoes_are_avoided() -> None:
    rig = Rig().goal(Goal(1, GoalKind.GOTO, 20.0, 0.0, 8.0, speed_m_s=2.0))
    nearest = math.inf
    for _ in range(400):
        t = rig.truth
        ranges = [10.0] * 72
        for beam in range(72):
            angle = t.yaw_rad - math.pi + beam * math.tau / 72
            along = (8.0 - t.x_m) * math.cos(angle) + (0.1 - t.y_m) * math.sin(angle)
            across = (8.0 - t.x_m) * math.sin(angle) - (0.1 - t.y_m) * math.cos(angle)
            if along > 0 and abs(across) < 0.5:
                ranges[beam] = min(10.0, along - math.sqrt(0.25 - across * across))
        rig.navigator.on_scan(Range(-math.pi, math.tau / 72, 10.0, tuple(ranges)), rig.now_ns + STEP_NS)
        rig.go(0.05)
        nearest = min(nearest, math.hypot(rig.truth.x_m - 8.0, rig.truth.y_m - 0.1) - 0.5)
    assert nearest > 0.3
    assert rig.status.state == "arrived"


@pytest.mark.parametrize(("late_s", "drives"), [(0.0, True), (0.15, False)])
def test_late_vehicle_does_not_forget_what_it_saw(late_s: float, drives: bool) -> None:
    rig = Rig("ugv", "ugv1").go(0.2).goal(Goal(1, GoalKind.GOTO, 20.0, 0.0, 0.0, speed_m_s=2.0))
    around = Range(-math.pi, math.tau / 72, 10.0, (0.45,) * 72)
    rig.navigator.on_scan(around, rig.now_ns)
    rig.go(0.05)
    assert rig.stands
    # an older scan is not used, but for as long as its own steps were late a node took no newer one
    rig.go(0.4)
    now_ns = rig.now_ns + 4 * STEP_NS
    setpoint = rig.navigator.step(now_ns, round(late_s * 1e9)).setpoint
    assert (setpoint.vx_m_s > 0.1) == drives


def test_late_ground_vehicle_plans_from_effective_place() -> None:
    found = []
    for delay_s in (0.0, 0.8):
        pilot = GroundController(Config())
        target = Target(20.0, 0.0, 0.0, None, 2.0, (20.0, 0.0), (2.0, 0.0, 0.0))
        turning = Pose.planar(10.0, 0.0, 0.0, 0.0, (2.0, 0.0, 0.0), 0.6)
        found.append(pilot.steer(turning, target, Surroundings(delay_s=delay_s), 1_000_000_000))
    # on the line, it turns still: a late one will be beside the line, and must turn back
    on_time, late = found
    assert on_time.wz_rad_s > -0.05
    assert late.wz_rad_s < -0.05


def test_braking_vehicle_does_not_curl_into_obstacle() -> None:
    found = []
    for delay_s in (0.0, 0.4):
        around = tuple((1.2 * math.cos(i / 10), 1.2 * math.sin(i / 10)) for i in range(63))
        moving = Pose.planar(0.0, 0.0, 0.0, 0.0, (2.0, 0.0, 0.0), -1.0)
        target = Target(20.0, 0.0, 0.0, None, 2.0, (20.0, 0.0), (2.0, 0.0, 0.0))
        pilot = GroundController(Config())
        pilot.steer(moving, target, Surroundings(), 1_000_000_000)
        found.append(pilot.steer(moving, target, Surroundings(around, (), delay_s), 1_200_000_000))
    on_time, late = found
    # the speed has fallen by the next step, and the arc is the same only if the rate has fallen with it
    assert on_time.vx_m_s == late.vx_m_s == 0.0
    assert on_time.wz_rad_s < -0.8
    # half a radian per second when the set-point takes effect, and a fifth of the speed less at the next step
    assert -0.4 < late.wz_rad_s < 0.0


def test_status_comes_at_rate_and_change() -> None:
    rig = Rig().go(2.0)
    before = len(rig.said)
    assert before == pytest.approx(2.0 * Config().status_hz, abs=2)
    rig.goal(Goal(9, GoalKind.HOLD)).go(0.05)
    assert len(rig.said) == before + 1
    assert rig.said[-1].goal_seq == 9


def test_the_same_goal_again_changes_nothing() -> None:
    goal = Goal(1, GoalKind.GOTO, 5.0, 0.0, 8.0)
    rig = Rig().goal(goal).go(10.0)
    count = len(rig.said)
    rig.goal(goal).go(0.05)
    assert rig.status.state == "arrived"
    assert len(rig.said) - count <= 1


def test_disarmed_grounded_vehicle_has_rest_rate() -> None:
    rig = Rig("ugv")
    moving_s, resting_s = 1 / Config().rate_hz, 1 / Config().rest_hz
    assert resting_s > moving_s
    assert rig.navigator.period_s() == moving_s
    rig.vehicle(False, True)
    assert rig.navigator.period_s() == resting_s
    rig.vehicle(False, False)
    assert rig.navigator.period_s() == moving_s, "it falls"
    rig.vehicle(True, True)
    assert rig.navigator.period_s() == moving_s


def test_rate_of_rest_is_never_above_usual_one() -> None:
    config = Config(rate_hz=12.0, rest_hz=20.0)
    navigator = NavigatorCore(config, "ugv1", ORIGIN, GroundController(config))
    navigator.on_vehicle(VehicleState(False, True))
    assert navigator.period_s() == 1 / 12


def test_resting_vehicle_finds_pose_at_rest_rate() -> None:
    rig = Rig("ugv")
    rig.vehicle(False, True)
    for _ in range(40):
        rig.now_ns += round(1e9 / Config().rest_hz)
        rig.navigator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0), rig.now_ns)
        rig.navigator.on_gnss(GnssFix(*rig.map.to_wgs84(0.0, 0.0, 0.0), 0.02, 12), rig.now_ns)
        rig.last = rig.navigator.step(rig.now_ns)
    pose = rig.last.pose
    assert pose is not None
    assert (pose.vx_m_s, pose.vy_m_s) == (0.0, 0.0)
    assert rig.navigator.step(rig.now_ns + 1).pose is pose, "at rest it states the same pose again"
