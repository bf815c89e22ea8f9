"""An aircraft that cannot stop: its circle, its speed, its approach, and the navigator that directs it."""

import math

import msgspec
import pytest
from tests.unit.airframes import aerosonde

from swarmd.navigator.config import Config
from swarmd.navigator.core.circling_controller import CirclingController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.navigator.core.target import MovingObstacle, Surroundings, Target
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.types.navigation import Goal, GoalKind, NavError, NavState, NavStatus
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

CONFIG, FREE = Config(), Surroundings()
SPEED = 22.0


AIRCRAFT = aerosonde()
LIMITS = AIRCRAFT.limits
RADIUS = LIMITS.loiter_radius_m


def at(x: float, y: float, course_deg: float, z: float = 40.0) -> Pose:
    course = math.radians(course_deg)
    return Pose.planar(x, y, z, course, (SPEED * math.cos(course), SPEED * math.sin(course), 0.0))


def place(x: float, y: float, z: float = 40.0, speed: float = SPEED) -> Target:
    return Target(x, y, z, None, speed, (x, y))


def course_deg(pose: Pose, wanted: Setpoint) -> float:
    """Course of a set-point in the map, from -180 to 180."""
    return math.degrees(math.remainder(pose.yaw_rad + math.atan2(wanted.vy_m_s, wanted.vx_m_s), math.tau))


def steer(pose: Pose, target: Target, around: Surroundings = FREE) -> Setpoint:
    return CirclingController(CONFIG, AIRCRAFT).steer(pose, target, around, 1)


def test_far_away_it_flies_to_the_target() -> None:
    pose = at(-2000.0, 0.0, 90.0)
    assert course_deg(pose, steer(pose, place(0.0, 0.0))) == pytest.approx(0.0, abs=5.0)


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 200.0])
def test_aircraft_follows_circle_left_with_fed_turn(bearing_deg: float) -> None:
    bearing = math.radians(bearing_deg)
    pose = at(RADIUS * math.cos(bearing), RADIUS * math.sin(bearing), bearing_deg + 90.0)
    wanted = steer(pose, place(0.0, 0.0))
    off = course_deg(pose, wanted) - bearing_deg - 90.0
    assert math.remainder(off, 360.0) == pytest.approx(0.0, abs=0.1)
    assert wanted.wz_rad_s == pytest.approx(SPEED / RADIUS)


def test_course_turns_inwards_outside_and_outwards_inside() -> None:
    wide, tight = at(1.2 * RADIUS, 0.0, 90.0), at(0.8 * RADIUS, 0.0, 90.0)
    assert 90.0 < course_deg(wide, steer(wide, place(0.0, 0.0))) < 180.0
    assert 0.0 < course_deg(tight, steer(tight, place(0.0, 0.0))) < 90.0


@pytest.mark.parametrize(
    ("asked", "flown"),
    [(1.5, LIMITS.airspeed_cruise_m_s), (20.0, 20.0), (99.0, LIMITS.airspeed_max_m_s)],
)
def test_its_speed_is_one_that_it_can_fly(asked: float, flown: float) -> None:
    wanted = steer(at(-500.0, 0.0, 0.0), place(0.0, 0.0, speed=asked))
    assert math.hypot(wanted.vx_m_s, wanted.vy_m_s) == pytest.approx(flown)


def test_climb_stays_within_airframe_and_target() -> None:
    pose = at(-500.0, 0.0, 0.0)
    assert steer(pose, place(0.0, 0.0, 200.0)).vz_m_s == LIMITS.climb_max_m_s
    assert steer(pose, place(0.0, 0.0, 0.0)).vz_m_s == -LIMITS.sink_max_m_s
    slow = msgspec.structs.replace(place(0.0, 0.0, 200.0), climb_m_s=1.0)
    assert steer(pose, slow).vz_m_s == 1.0


def test_it_evades_without_flying_slower() -> None:
    pose = at(-500.0, 0.0, 0.0)
    ahead = Surroundings((), (MovingObstacle(-460.0, 0.0, 40.0, 0.0, 0.0, 0.0),))
    wanted = steer(pose, place(500.0, 0.0), ahead)
    assert wanted != steer(pose, place(500.0, 0.0))
    assert math.hypot(wanted.vx_m_s, wanted.vy_m_s) == pytest.approx(SPEED)


def test_hold_begins_circle_in_place() -> None:
    pose = at(10.0, 20.0, 90.0)
    assert CirclingController(CONFIG, AIRCRAFT).hold_at(pose) == pytest.approx((10.0 - RADIUS, 20.0))


def test_landing_descends_on_circle_into_final_approach() -> None:
    """Landing east at the origin: the circle lies to the left of the line, 180 m before the place."""
    controller = CirclingController(CONFIG, AIRCRAFT)
    stay = place(0.0, RADIUS)
    high = controller.descend(at(0.0, 0.0, 0.0, 60.0), stay, 1.0)
    assert (high.x_m, high.y_m) == pytest.approx((-180.0, RADIUS))
    assert high.course_rad is None and 3.0 < high.z_m < 15.0
    too_high = controller.descend(at(-180.0, 0.0, 0.0, 40.0), stay, 1.0)
    assert too_high.course_rad is None
    across = controller.descend(at(-180.0, 0.0, 90.0, 9.0), stay, 1.0)
    assert across.course_rad is None
    final = controller.descend(at(-180.0, 0.0, 0.0, 9.0), stay, 1.0)
    assert final.course_rad == pytest.approx(0.0)
    left = controller.descend(at(-120.0, 5.0, 0.0, 6.0), stay, 1.0)
    assert left.course_rad is not None and left.course_rad < -0.1
    low = controller.descend(at(-60.0, 0.0, 0.0, 2.0), stay, 1.0)
    assert low.z_m < 0.0 and controller.steer(at(-60.0, 0.0, 0.0, 2.0), low, FREE, 1).vz_m_s < -1.0


def test_a_stop_ends_the_approach() -> None:
    controller = CirclingController(CONFIG, AIRCRAFT)
    stay = place(0.0, RADIUS)
    begun, later = at(-180.0, 0.0, 0.0, 9.0), at(-100.0, 0.0, 0.0, 5.0)
    assert controller.descend(begun, stay, 1.0).course_rad is not None
    assert controller.descend(later, stay, 1.0).course_rad is not None
    assert controller.stop() == Setpoint(0.0)
    assert controller.descend(later, stay, 1.0).course_rad is None


class Pilot:
    """A navigator with exact measurements of its aircraft's position."""

    def __init__(self) -> None:
        self.core = NavigatorCore(CONFIG, "uav1", Origin(), CirclingController(CONFIG, AIRCRAFT))
        self.map = LocalMap(Origin())
        self.now_ns = 1_000_000_000
        self.core.on_vehicle(VehicleState(True, False))
        self.seq = 0
        self.status = NavStatus(0, NavState.IDLE)

    def goal(self, kind: GoalKind, **fields: float) -> None:
        self.seq += 1
        self.core.on_goal(Goal(self.seq, kind, **fields), self.now_ns)  # type: ignore[arg-type]  # by name

    def see(self, x: float, y: float, z: float = 40.0) -> tuple[NavState, NavError, float, str]:
        """The status with the aircraft at a position, once the estimate has converged."""
        for _ in range(80):
            self.now_ns += 50_000_000
            self.core.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0, 0.0, 0.0), self.now_ns)
            self.core.on_gnss(GnssFix(*self.map.to_wgs84(x, y, z), 0.02, 12), self.now_ns)
            self.status = self.core.step(self.now_ns).status or self.status
        return self.status.state, self.status.error, self.status.distance_m, self.status.note


def test_aircraft_arrives_on_circle_around_goal() -> None:
    pilot = Pilot()
    pilot.goal(GoalKind.GOTO, x_m=500.0, y_m=0.0, z_m=40.0)
    state, _, distance, _ = pilot.see(0.0, 0.0)
    assert state is NavState.MOVING
    assert distance == pytest.approx(500.0 - RADIUS, abs=1.0)
    assert pilot.status.circle_m == RADIUS, "it tells who waits for it that it cannot stop"
    assert pilot.see(500.0, RADIUS + 5.0)[0] is NavState.ARRIVED
    assert pilot.see(500.0, RADIUS + 50.0)[0] is NavState.MOVING


def test_it_has_climbed_when_the_height_is_right() -> None:
    pilot = Pilot()
    pilot.see(0.0, 0.0, 20.0)
    pilot.goal(GoalKind.TAKEOFF, z_m=40.0, speed_m_s=3.0)
    assert pilot.see(0.0, 0.0, 36.0)[0] is NavState.MOVING
    assert pilot.see(0.0, 0.0, 39.0)[0] is NavState.ARRIVED


def test_it_holds_while_it_circles() -> None:
    pilot = Pilot()
    pilot.see(0.0, 0.0)
    pilot.goal(GoalKind.HOLD)
    assert pilot.see(0.0, 0.0)[0] is NavState.HOLDING
    assert pilot.see(0.0, 3 * RADIUS + 20.0)[0] is NavState.MOVING


def test_a_slot_in_a_formation_is_refused() -> None:
    pilot = Pilot()
    pilot.core.on_goal(Goal(1, GoalKind.FORMATION, leader="ugv1", course=((0.0, 0.0), (9.0, 0.0))), 1)
    state, error, _, note = pilot.see(0.0, 0.0)
    assert (state, error) == (NavState.BLOCKED, NavError.BAD_GOAL)
    assert "cannot stop" in note
