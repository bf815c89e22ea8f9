"""The navigator: measurements and a goal in, pose, set-point and status out."""

import math
from typing import Final, Protocol

import msgspec

from swarmd.navigator.config import Config
from swarmd.navigator.core.estimator import Estimator
from swarmd.navigator.core.keeper import FormationKeeper
from swarmd.navigator.core.target import Neighbour, Surroundings, Target
from swarmware.errors import InvalidInput
from swarmware.geodesy import Origin
from swarmware.types.vehicle import (
    GOAL_KINDS,
    GnssFix,
    Goal,
    Imu,
    NavError,
    NavStatus,
    Pose,
    Range,
    Setpoint,
    VehicleState,
)

_STOP: Final = Setpoint(0.0)
_ARM_GRACE_S: Final = 1.0
"""A goal may overtake the news that the motors are armed by this much."""
_EXTRAPOLATE_S: Final = 1.0
"""A neighbour's velocity holds no longer than this."""
_STILL_M_S: Final = 0.1
_FINAL_M: Final = 1.5
"""Below this height a landing vehicle sinks with the touch-down speed."""
_DEEP_M: Final = 10.0
"""A landing vehicle aims below the ground, or it would hover a hand's breadth above it."""
_SCAN_AGE_S: Final = 0.5


class Pilot(Protocol):
    """What the navigator needs of a pilot."""

    free: bool

    @property
    def flies(self) -> bool: ...
    def set_config(self, config: Config) -> None: ...
    def stop(self) -> Setpoint: ...
    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint: ...


class Step(msgspec.Struct, frozen=True):
    """What one call of `on_timer` brought."""

    pose: Pose | None
    """The own estimate; None: nothing to tell anybody."""
    setpoint: Setpoint
    status: NavStatus | None
    """When it changed, and at its rate."""


class _Plan(msgspec.Struct, frozen=True):
    """What to do now, and what to say about it."""

    state: str
    target: Target | None = None
    """None: stop."""
    distance_m: float = 0.0
    error_m: float = 0.0
    error: NavError = NavError.NONE
    note: str = ""
    blockable: bool = False
    """Standing still is no progress."""


class Navigator:
    """Estimator, goal and pilot of one vehicle."""

    def __init__(self, config: Config, platform: str, origin: Origin, pilot: Pilot) -> None:
        self._config = config
        self._platform = platform
        self._pilot = pilot
        self._estimator = Estimator(config.estimator, origin)
        self._vehicle: VehicleState | None = None
        self._neighbours: dict[str, tuple[Pose, int]] = {}
        self._points: tuple[tuple[float, float], ...] = ()
        self._scan: Range | None = None
        self._scan_ns = -(1 << 62)
        self._goal: Goal | None = None
        self._goal_ns = 0
        self._keeper: FormationKeeper | None = None
        self._mistake = ""
        self._anchor: Pose | None = None
        self._arrived = False
        self._setpoint = _STOP
        self._moved_ns = 0
        self._was: tuple[float, float, float] | None = None
        self._status = NavStatus(0, "idle")
        self._status_ns = -(1 << 62)

    def set_config(self, config: Config) -> None:
        """New weights and gains, while moving (S2.46)."""
        self._config = config
        self._pilot.set_config(config)

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """A position fix."""
        self._estimator.on_gnss(fix, stamp_ns)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Rates, specific force, heading."""
        self._estimator.on_imu(imu, stamp_ns)

    def on_height(self, height_m: float) -> None:
        """Height above the ground."""
        self._estimator.on_height(height_m)

    def on_vehicle(self, state: VehicleState) -> None:
        """Armed, landed."""
        self._vehicle = state

    def on_scan(self, scan: Range, stamp_ns: int) -> None:
        """Echoes around, with the first beam at `angle_min_rad` of the body."""
        if stamp_ns > self._scan_ns:
            self._scan, self._scan_ns = scan, stamp_ns

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        """Where another platform was, in the own clock."""
        self._neighbours[platform] = (pose, stamp_ns)

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        """What to do from now on; the same again changes nothing."""
        if self._goal == goal:
            return
        self._goal, self._goal_ns, self._moved_ns = goal, now_ns, now_ns
        self._keeper, self._mistake, self._anchor, self._arrived = None, "", None, False
        if goal.kind not in GOAL_KINDS:
            self._mistake = f"goal {goal.kind!r}: expected one of {', '.join(GOAL_KINDS)}"
        elif goal.kind == "takeoff" and not self._pilot.flies:
            self._mistake = "takeoff: this vehicle does not fly"
        elif goal.kind == "formation":
            try:
                self._keeper = FormationKeeper(self._config, goal, self._pilot.flies)
            except InvalidInput as error:
                self._mistake = str(error)
            else:
                if goal.leader == self._platform and not self._keeper.has_course:
                    self._mistake = "leading a formation: expected a course"

    def on_timer(self, now_ns: int) -> Step:
        """Pose, set-point and status for now."""
        vehicle = self._vehicle
        landed = vehicle is not None and vehicle.landed
        armed = vehicle is not None and vehicle.armed
        self._estimator.on_driven(not landed or (armed and self._setpoint != _STOP))
        self._estimator.predict(now_ns)
        if landed and armed and self._pilot.flies:
            self._estimator.on_landed()
        pose = self._estimator.pose()
        if pose is not None and self._scan is not None:
            self._points = self._echoes(pose, self._scan)
            self._scan = None
        plan = self._plan(pose, now_ns)
        if pose is None or plan.target is None:
            setpoint = self._pilot.stop()
        else:
            setpoint = self._pilot.steer(pose, plan.target, self._around(now_ns), now_ns)
        self._setpoint = setpoint
        return Step(pose, setpoint, self._report(self._checked(plan, pose, now_ns), now_ns))

    # what to do

    def _plan(self, pose: Pose | None, now_ns: int) -> _Plan:
        goal = self._goal
        if self._mistake:
            return _Plan("blocked", self._stay(pose), error=NavError.BAD_GOAL, note=self._mistake)
        if pose is None:
            return _Plan("idle" if goal is None else "holding", error=NavError.NO_POSITION)
        if goal is None:
            return _Plan("idle", self._stay(pose))
        if goal.kind == "land":
            return self._land(goal, pose)
        if goal.kind == "hold":
            standing = math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s) < 2 * _STILL_M_S
            return _Plan("holding" if standing else "moving", self._stay(pose))
        if self._vehicle is None or not self._vehicle.armed:
            waiting = self._vehicle is None or now_ns - self._goal_ns < _ARM_GRACE_S * 1e9
            return _Plan("moving" if waiting else "blocked", error=NavError.DISARMED)
        if goal.kind == "takeoff":
            return self._take_off(goal, pose)
        if goal.kind == "goto":
            return self._go(goal, pose)
        return self._form(goal, pose, now_ns)

    def _stay(self, pose: Pose | None) -> Target | None:
        """Hold the place where the goal came; on the ground, and without a goal on the ground, stop."""
        if pose is None or not self._pilot.flies or self._vehicle is None or self._vehicle.landed:
            return None
        if self._anchor is None:
            # where it will have stopped, not where it is: no swinging back
            air = self._config.air
            slip = math.hypot(pose.vx_m_s, pose.vy_m_s) / (2 * air.a_max_m_s2)
            self._anchor = Pose.planar(
                pose.x_m + pose.vx_m_s * slip, pose.y_m + pose.vy_m_s * slip, max(pose.z_m, 1.0), pose.yaw_rad
            )
        anchor = self._anchor
        return Target(
            anchor.x_m,
            anchor.y_m,
            anchor.z_m,
            anchor.yaw_rad,
            self._config.air.v_max_m_s,
            (anchor.x_m, anchor.y_m),
        )

    def _land(self, goal: Goal, pose: Pose) -> _Plan:
        stay = self._stay(pose)
        if stay is None:
            standing = math.hypot(pose.vx_m_s, pose.vy_m_s) < _STILL_M_S
            return _Plan("arrived" if standing or self._pilot.flies else "moving")
        speed = (
            goal.speed_m_s if pose.z_m > _FINAL_M else min(goal.speed_m_s, self._config.air.touch_down_m_s)
        )
        down = msgspec.structs.replace(stay, z_m=pose.z_m - _DEEP_M, climb_m_s=speed)
        return _Plan("moving", down, distance_m=max(0.0, pose.z_m))

    def _take_off(self, goal: Goal, pose: Pose) -> _Plan:
        if self._anchor is None:
            self._anchor = pose
        anchor = self._anchor
        distance = abs(goal.z_m - pose.z_m)
        target = Target(
            anchor.x_m,
            anchor.y_m,
            goal.z_m,
            anchor.yaw_rad,
            self._config.air.v_max_m_s,
            (anchor.x_m, anchor.y_m),
            climb_m_s=goal.speed_m_s,
        )
        return self._reached(target, distance, distance, self._config.arrive_m, blockable=True)

    def _go(self, goal: Goal, pose: Pose) -> _Plan:
        height = goal.z_m - pose.z_m if self._pilot.flies else 0.0
        distance = math.hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m, height)
        yaw = goal.yaw_rad
        if yaw is None and self._pilot.flies and distance > 2.0:
            yaw = math.atan2(goal.y_m - pose.y_m, goal.x_m - pose.x_m)
        target = Target(goal.x_m, goal.y_m, goal.z_m, yaw, goal.speed_m_s, (goal.x_m, goal.y_m))
        turned = yaw is None or distance > 2.0 or abs(math.remainder(yaw - pose.yaw_rad, math.tau)) < 0.1
        arrive = self._config.arrive_m if turned else 0.0
        plan = self._reached(target, distance, distance, arrive, blockable=True)
        if plan.state == "arrived" and not self._pilot.flies and goal.yaw_rad is None:
            return msgspec.structs.replace(plan, target=None)
        return plan

    def _form(self, goal: Goal, pose: Pose, now_ns: int) -> _Plan:
        keeper = self._keeper
        if keeper is None:
            return _Plan("blocked", self._stay(pose), error=NavError.BAD_GOAL, note=self._mistake)
        leads = goal.leader == self._platform
        if leads:
            place = keeper.lead(pose, now_ns)
        else:
            leader = self._leader(goal.leader, now_ns)
            if leader is None:
                return _Plan("holding", self._stay(pose), error=NavError.LEADER_LOST, note=goal.leader)
            self._anchor = None
            place = keeper.follow(pose, leader)
        arrive = self._config.formation_arrive_m
        distance = place.remaining_m if leads and goal.advance else place.error_m
        done = 0.0 if place.remaining_m <= (arrive if leads else 0.0) and place.still else math.inf
        plan = self._reached(
            place.target, distance, max(place.error_m, done), arrive, blockable=distance > 2 * arrive
        )
        return msgspec.structs.replace(plan, error_m=place.error_m)

    def _reached(
        self, target: Target, distance_m: float, wrong_m: float, arrive_m: float, *, blockable: bool
    ) -> _Plan:
        """Arrived stays arrived until it is twice as far off."""
        self._arrived = wrong_m < (2 * arrive_m if self._arrived else arrive_m)
        return _Plan(
            "arrived" if self._arrived else "moving",
            target,
            distance_m,
            blockable=blockable and not self._arrived,
        )

    # what is around

    def _echoes(self, pose: Pose, scan: Range) -> tuple[tuple[float, float], ...]:
        """The scan in the map, from where the scanner was when it looked."""
        late_s = self._estimator.since_s(self._scan_ns)
        x, y = pose.x_m - pose.vx_m_s * late_s, pose.y_m - pose.vy_m_s * late_s
        first = pose.yaw_rad - pose.wz_rad_s * late_s + scan.angle_min_rad
        found = []
        for i, length in enumerate(scan.ranges_m):
            if length < scan.max_m:
                angle = first + i * scan.angle_step_rad
                found.append((x + length * math.cos(angle), y + length * math.sin(angle)))
        return tuple(found)

    def _leader(self, platform: str, now_ns: int) -> Pose | None:
        found = self._neighbours.get(platform)
        if found is None or now_ns - found[1] > self._config.leader_timeout_s * 1e9:
            return None
        pose, stamp_ns = found
        ahead_s = min(max((now_ns - stamp_ns) / 1e9, 0.0), _EXTRAPOLATE_S)
        yaw = pose.yaw_rad + pose.wz_rad_s * ahead_s
        return Pose.planar(
            pose.x_m + pose.vx_m_s * ahead_s,
            pose.y_m + pose.vy_m_s * ahead_s,
            pose.z_m + pose.vz_m_s * ahead_s,
            yaw,
            (pose.vx_m_s, pose.vy_m_s, pose.vz_m_s),
            pose.wz_rad_s,
        )

    def _around(self, now_ns: int) -> Surroundings:
        found = []
        for platform, (pose, stamp_ns) in list(self._neighbours.items()):
            age_s = (now_ns - stamp_ns) / 1e9
            if age_s > self._config.neighbour_timeout_s:
                del self._neighbours[platform]
                continue
            ahead_s = min(max(age_s, 0.0), _EXTRAPOLATE_S)
            found.append(
                Neighbour(
                    pose.x_m + pose.vx_m_s * ahead_s,
                    pose.y_m + pose.vy_m_s * ahead_s,
                    pose.z_m + pose.vz_m_s * ahead_s,
                    pose.vx_m_s,
                    pose.vy_m_s,
                    pose.vz_m_s,
                    platform > self._platform,
                )
            )
        fresh = now_ns - self._scan_ns < _SCAN_AGE_S * 1e9
        return Surroundings(self._points if fresh else (), tuple(found))

    # what to say

    def _checked(self, plan: _Plan, pose: Pose | None, now_ns: int) -> _Plan:
        """Blocked when there should be progress and is none."""
        here = None if pose is None else (pose.x_m, pose.y_m, pose.z_m)
        # a way, not a speed: one that drives to and fro before an obstacle has a speed, too
        least_m = _STILL_M_S * self._config.blocked_s
        moves = here is not None and (self._was is None or math.dist(here, self._was) > least_m)
        if moves or not plan.blockable:
            self._moved_ns, self._was = now_ns, here
        if now_ns - self._moved_ns > self._config.blocked_s * 1e9:
            return msgspec.structs.replace(plan, state="blocked", error=NavError.NO_WAY)
        return plan

    def _report(self, plan: _Plan, now_ns: int) -> NavStatus | None:
        status = NavStatus(
            self._goal.seq if self._goal else 0,
            plan.state,
            round(plan.distance_m, 3),
            round(plan.error_m, 3),
            plan.note,
            plan.error,
        )
        changed = _told(status) != _told(self._status)
        if not changed and now_ns - self._status_ns < 0.99e9 / self._config.status_hz:
            return None
        self._status, self._status_ns = status, now_ns
        return status


def _told(status: NavStatus) -> object:
    """What is said at once; the rest can wait for the rate."""
    return status.goal_seq, status.state, status.error, status.note
