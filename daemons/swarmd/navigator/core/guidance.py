"""Guidance, which computes set-point and status from the estimated pose, a goal and obstacles."""

import math
from typing import Final

import msgspec

from swarmd.navigator.config import Config
from swarmd.navigator.core.caution import cautious
from swarmd.navigator.core.controller import Controller
from swarmd.navigator.core.keeper import FormationKeeper
from swarmd.navigator.core.pace import TURNS
from swarmd.navigator.core.prediction import predicted
from swarmd.navigator.core.route import Point, RouteSearch, SeenObstacles
from swarmd.navigator.core.target import MovingObstacle, Surroundings, Target
from swarmware.errors import InvalidInput
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.navigation import Goal, GoalKind, NavError, NavState, NavStatus
from swarmware.types.vehicle import Pose, Range, Setpoint, VehicleState

_STOP: Final = Setpoint(0.0)
_ARM_GRACE_S: Final = 1.0
"""Maximum time by which a goal may arrive before the state that the motors are armed."""
_EXTRAPOLATE_S: Final = 1.0
"""Maximum extrapolation of the pose of another platform."""
_STILL_M_S: Final = 0.1
_CIRCLING_HEIGHT_M: Final = 2.0
"""Maximum error of the height at which a circling vehicle has reached its altitude."""
_BLIND_FINAL_M: Final = 2.0
"""Measured height below which a landing without a position descends at touch-down speed."""
_STRAYS: Final = 4
"""Multiple of `blocked_s` after which a vehicle that moves without approaching its goal is in a dead end."""
_CORNER_M: Final = 1.0
"""Distance at which a corner of a route counts as passed."""
_ROOM_M: Final = 0.1
"""Clearance of a route beyond radius and margin of the vehicle, equal to the clearance of a detour."""
_SCAN_AGE_S: Final = 0.5
"""Maximum age of used echoes, to which the delay of the own steps is added."""
_ENDED_BY_HAND: Final = frozenset({GoalKind.TAKEOFF, GoalKind.GOTO, GoalKind.LAND, GoalKind.DESCEND})
"""Kinds of reached goals that manual driving ends, so that the vehicle later stays where it is."""


class GuidanceOutput(msgspec.Struct, frozen=True):
    """The outputs of one control step."""

    setpoint: Setpoint
    status: NavStatus | None
    """Status if it changed or is due, else None."""


class _Plan(msgspec.Struct, frozen=True):
    """The decision of one control step: the target, and the status to report."""

    state: NavState
    target: Target | None = None
    """Target to steer to, or None to stop."""
    distance_m: float = 0.0
    error_m: float = 0.0
    error: NavError = NavError.NONE
    note: str = ""
    blockable: bool = False
    """True if missing progress means that the vehicle is blocked."""
    sink_m_s: float = 0.0
    """Rate of a descent without a position, or 0 without such a descent."""


class Guidance:
    """Connects pose, goal and controller of one vehicle."""

    def __init__(self, config: Config, platform: str, controller: Controller) -> None:
        self._config = config
        self._platform = platform
        self._controller = controller
        self._vehicle: VehicleState | None = None
        self._driven_by = ""
        """The operator or pilot that drives instead of the navigator, or "" if the navigator drives."""
        self._neighbours: dict[str, tuple[Pose, int]] = {}
        self._points: tuple[tuple[float, float], ...] = ()
        self._scan: Range | None = None
        self._scan_ns = -(1 << 62)
        self._goal: Goal | None = None
        self._goal_ns = 0
        self._keeper: FormationKeeper | None = None
        self._goal_error = ""
        self._anchor: Pose | None = None
        self._arrived = False
        self._circled: Goal | None = None
        """The goal around which an aircraft circled when the present goal arrived."""
        self._setpoint = _STOP
        self._moved_ns = 0
        self._moved_from: tuple[float, float, float] | None = None
        self._seen = SeenObstacles()
        """Obstacles that were seen on the way to the goal."""
        self._search: RouteSearch | None = None
        self._route: list[Point] = []
        """Remaining corners of the route around the obstacles."""
        self._replanned = False
        """True if a route was already searched for this goal; a second time the vehicle is blocked."""
        self._nearest_m, self._nearest_ns = math.inf, 0
        """The smallest distance to the goal so far, and the instant at which it was reached."""
        self._status = NavStatus(0, NavState.IDLE)
        self._status_ns = -(1 << 62)

    def set_config(self, config: Config) -> None:
        """Replaces weights and gains, also while moving (S2.46)."""
        self._config = config
        self._controller.set_config(config)

    def on_vehicle(self, state: VehicleState) -> None:
        """Takes the state of the vehicle with armed and landed."""
        self._vehicle = state

    def on_control(self, control: ControlState) -> None:
        """Takes the driver of the vehicle; manual driving ends a reached goal, so that the vehicle does not
        return."""
        if control.mode is DriveMode.AUTO:
            self._driven_by = ""
            return
        self._driven_by = control.holder or control.mode.value
        goal = self._goal
        if goal is not None and goal.kind in _ENDED_BY_HAND and self._status.state is NavState.ARRIVED:
            self._goal = msgspec.structs.replace(goal, kind=GoalKind.HOLD)

    def on_scan(self, scan: Range, stamp_ns: int) -> None:
        """Takes a scan; its first beam is at `angle_min_rad` in the body frame."""
        if stamp_ns > self._scan_ns:
            self._scan, self._scan_ns = scan, stamp_ns

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        """Takes the pose of another platform, stamped in the own clock."""
        self._neighbours[platform] = (pose, stamp_ns)

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        """Takes a goal; a repeated goal changes nothing."""
        if self._goal == goal:
            return
        # a landing then uses the place around which the aircraft circled
        self._circled = self._goal if self._arrived and self._controller.circle_m > 0.0 else None
        self._goal, self._goal_ns, self._moved_ns = goal, now_ns, now_ns
        self._keeper, self._goal_error, self._anchor, self._arrived = None, "", None, False
        self._search, self._route, self._replanned = None, [], False
        self._nearest_m, self._nearest_ns = math.inf, now_ns
        self._seen.clear()
        if not goal.kind.known:
            self._goal_error = f"goal {str(goal.kind)!r}: expected one of {', '.join(GoalKind)}"
        elif goal.kind is GoalKind.TAKEOFF and not self._controller.flies:
            self._goal_error = "takeoff: this vehicle does not fly"
        elif goal.kind is GoalKind.FORMATION and self._controller.circle_m > 0.0:
            self._goal_error = "formation: this vehicle cannot stop in a slot"
        elif goal.kind is GoalKind.FORMATION:
            try:
                self._keeper = FormationKeeper(self._config, goal, self._controller.flies)
            except InvalidInput as error:
                self._goal_error = str(error)
            else:
                if goal.leader == self._platform and not self._keeper.has_course:
                    self._goal_error = "leading a formation: expected a course"

    @property
    def resting(self) -> bool:
        """True if the vehicle is disarmed and on the ground."""
        return self._vehicle is not None and self._vehicle.resting

    @property
    def setpoint(self) -> Setpoint:
        """The set-point of the last step."""
        return self._setpoint

    def step(
        self, pose: Pose | None, now_ns: int, delay_ns: int = 0, height_m: float | None = None
    ) -> GuidanceOutput:
        """Computes set-point and status for this instant; without a valid pose the vehicle stops or lands.

        `delay_ns`: recent scheduling delay of the steps; `height_m`: measured height above the ground, or
        None without a measurement.
        """
        if pose is not None and self._scan is not None:
            self._points = self._echoes(pose, self._scan, now_ns, delay_ns)
            self._scan = None
            if self._goal is not None and self._goal.kind is GoalKind.GOTO:
                self._seen.add(self._points)
        plan = self._plan(pose, now_ns, height_m)
        if plan.sink_m_s > 0.0:
            setpoint = self._controller.sink(plan.sink_m_s)
        elif pose is None or plan.target is None:
            setpoint = self._controller.stop()
        else:
            around, flies = self._around(now_ns, delay_ns), self._controller.flies
            setpoint = self._controller.steer(pose, plan.target, around, now_ns)
            if self._controller.circle_m == 0.0:  # an aircraft needs its airspeed
                setpoint = cautious(setpoint, pose, around, flies=flies)
        self._setpoint = setpoint
        return GuidanceOutput(setpoint, self._report(self._checked(plan, pose, now_ns), now_ns))

    # the decision

    def _plan(self, pose: Pose | None, now_ns: int, height_m: float | None) -> _Plan:
        goal = self._goal
        if self._driven_by:
            self._anchor = None  # the vehicle then holds the position at which it is released
            return _Plan(NavState.HOLDING, note=f"driven by {self._driven_by}")
        if self._goal_error:
            return _Plan(NavState.BLOCKED, self._stay(pose), error=NavError.BAD_GOAL, note=self._goal_error)
        if goal is not None and (
            goal.kind is GoalKind.DESCEND
            or (goal.kind is GoalKind.LAND and pose is None and self._controller.flies)
        ):
            return self._descend(goal, height_m)
        if pose is None:
            return _Plan(NavState.IDLE if goal is None else NavState.HOLDING, error=NavError.NO_POSITION)
        if goal is None:
            return _Plan(NavState.IDLE, self._stay(pose))
        if goal.kind is GoalKind.LAND:
            return self._land(goal, pose)
        if goal.kind is GoalKind.HOLD:
            stay = self._stay(pose)
            return _Plan(NavState.HOLDING if self._holds(pose, stay) else NavState.MOVING, stay)
        if self._vehicle is None or not self._vehicle.armed:
            # the state may arrive a little later than the goal of the mission
            waiting = self._vehicle is None or now_ns - self._goal_ns < _ARM_GRACE_S * 1e9
            return _Plan(NavState.MOVING if waiting else NavState.BLOCKED, error=NavError.DISARMED)
        if goal.kind is GoalKind.TAKEOFF:
            return self._take_off(goal, pose)
        if goal.kind is GoalKind.GOTO:
            return self._go(goal, pose)
        return self._form(goal, pose, now_ns)

    def _stay(self, pose: Pose | None) -> Target | None:
        """Target that holds the position at which the goal arrived, or None to stop on the ground."""
        if pose is None or not self._controller.flies or self._vehicle is None or self._vehicle.landed:
            return None
        if self._anchor is None:
            x, y = self._controller.hold_at(pose)
            self._anchor = Pose.planar(x, y, max(pose.z_m, 1.0), pose.yaw_rad)
        anchor = self._anchor
        return Target(
            anchor.x_m,
            anchor.y_m,
            anchor.z_m,
            anchor.yaw_rad,
            self._config.air.v_max_m_s,
            (anchor.x_m, anchor.y_m),
        )

    def _holds(self, pose: Pose, stay: Target | None) -> bool:
        """True if the vehicle has stopped, or, if it cannot stop, is on the circle around its target."""
        if stay is None or self._controller.circle_m == 0.0:
            return math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s) < 2 * _STILL_M_S
        return self._away_m(pose, stay) < self._arrive_m

    def _away_m(self, pose: Pose, target: Target) -> float:
        """Distance from a target or from the circle around it; inside of the circle the height error only."""
        flat = math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m) - self._controller.circle_m
        height = target.z_m - pose.z_m if self._controller.flies else 0.0
        return math.hypot(max(0.0, flat), height)

    @property
    def _arrive_m(self) -> float:
        return max(self._config.arrive_m, self._controller.arrive_m)

    def _land(self, goal: Goal, pose: Pose) -> _Plan:
        if self._anchor is None and self._circled is not None and self._circled.kind is GoalKind.GOTO:
            # the aircraft lands at the place around which it circles, not somewhere on the circle
            place = msgspec.structs.replace(pose, x_m=self._circled.x_m, y_m=self._circled.y_m)
            x, y = self._controller.hold_at(place)
            self._anchor = Pose.planar(x, y, max(pose.z_m, 1.0), pose.yaw_rad)
        stay = self._stay(pose)
        if stay is None:
            hovers = self._controller.flies and self._controller.circle_m == 0.0
            standing = math.hypot(pose.vx_m_s, pose.vy_m_s) < _STILL_M_S
            return _Plan(NavState.ARRIVED if hovers or standing else NavState.MOVING)
        down = self._controller.descend(pose, stay, goal.speed_m_s)
        return _Plan(NavState.MOVING, down, distance_m=max(0.0, pose.z_m))

    def _descend(self, goal: Goal, height_m: float | None) -> _Plan:
        """Plan of a landing by height alone, which keeps no position and avoids nothing."""
        if not self._controller.flies or (self._vehicle is not None and self._vehicle.landed):
            return _Plan(NavState.ARRIVED)
        self._anchor = None  # when the position becomes valid again, the vehicle holds at that position
        sink = self._config.air.touch_down_m_s
        if goal.kind is GoalKind.LAND and height_m is not None and height_m > _BLIND_FINAL_M:
            sink = max(sink, goal.speed_m_s)
        left_m = 0.0 if height_m is None else max(height_m, 0.0)
        return _Plan(NavState.MOVING, sink_m_s=sink, distance_m=left_m, note="lands by height alone")

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
        arrive = self._config.arrive_m if self._controller.circle_m == 0.0 else _CIRCLING_HEIGHT_M
        return self._reached(target, distance, distance, arrive, blockable=True)

    def _go(self, goal: Goal, pose: Pose) -> _Plan:
        target = Target(goal.x_m, goal.y_m, goal.z_m, goal.yaw_rad, goal.speed_m_s, (goal.x_m, goal.y_m))
        distance, yaw = self._away_m(pose, target), goal.yaw_rad
        while self._route and math.dist(self._route[0], (pose.x_m, pose.y_m)) < _CORNER_M:
            del self._route[0]
        if self._route:
            x, y = self._route[0]
            ahead = math.atan2(y - pose.y_m, x - pose.x_m) if self._controller.flies else None
            target = Target(x, y, goal.z_m, ahead, goal.speed_m_s, (x, y))
            return _Plan(NavState.MOVING, target, distance, note="detour", blockable=True)
        if yaw is None and self._controller.flies and distance > 2.0:
            ahead = math.atan2(goal.y_m - pose.y_m, goal.x_m - pose.x_m)
            target = msgspec.structs.replace(target, yaw_rad=ahead)
        turned = (
            yaw is None
            or distance > 2.0
            or self._controller.circle_m > 0.0
            or abs(math.remainder(yaw - pose.yaw_rad, math.tau)) < 0.1
        )
        arrive = self._arrive_m if turned else 0.0
        plan = self._reached(target, distance, distance, arrive, blockable=True)
        if plan.state is NavState.ARRIVED and not self._controller.flies and goal.yaw_rad is None:
            return msgspec.structs.replace(plan, target=None)
        return plan

    def _form(self, goal: Goal, pose: Pose, now_ns: int) -> _Plan:
        keeper = self._keeper
        if keeper is None:
            return _Plan(NavState.BLOCKED, self._stay(pose), error=NavError.BAD_GOAL, note=self._goal_error)
        leads = goal.leader == self._platform
        if leads:
            place = keeper.lead(pose, now_ns)
        else:
            leader = self._leader(goal.leader, now_ns)
            if leader is None:
                return _Plan(NavState.HOLDING, self._stay(pose), error=NavError.LEADER_LOST, note=goal.leader)
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
        self, target: Target, distance_m: float, error_m: float, arrive_m: float, *, blockable: bool
    ) -> _Plan:
        """Applies the arrival radius, with hysteresis up to twice the radius."""
        self._arrived = error_m < (2 * arrive_m if self._arrived else arrive_m)
        return _Plan(
            NavState.ARRIVED if self._arrived else NavState.MOVING,
            target,
            distance_m,
            blockable=blockable and not self._arrived,
        )

    # the obstacles

    def _echoes(self, pose: Pose, scan: Range, now_ns: int, delay_ns: int) -> tuple[tuple[float, float], ...]:
        """Converts a scan to map coordinates, with the pose at the stamp of the scan."""
        late_s = min(max((now_ns - self._scan_ns) / 1e9, 0.0), _scan_age_s(delay_ns))
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
        return predicted(pose, min(max((now_ns - stamp_ns) / 1e9, 0.0), _EXTRAPOLATE_S))

    def _around(self, now_ns: int, delay_ns: int) -> Surroundings:
        found = []
        for platform, (pose, stamp_ns) in list(self._neighbours.items()):
            age_s = (now_ns - stamp_ns) / 1e9
            if age_s > self._config.neighbour_timeout_s:
                del self._neighbours[platform]
                continue
            ahead_s = min(max(age_s, 0.0), _EXTRAPOLATE_S)
            found.append(
                MovingObstacle(
                    pose.x_m + pose.vx_m_s * ahead_s,
                    pose.y_m + pose.vy_m_s * ahead_s,
                    pose.z_m + pose.vz_m_s * ahead_s,
                    pose.vx_m_s,
                    pose.vy_m_s,
                    pose.vz_m_s,
                    # the order of the names decides who gives way, the same at both vehicles
                    platform > self._platform,
                    max(age_s, 0.0),
                )
            )
        fresh = now_ns - self._scan_ns < _scan_age_s(delay_ns) * 1e9
        return Surroundings(self._points if fresh else (), tuple(found), delay_ns / 1e9)

    # the status

    def _checked(self, plan: _Plan, pose: Pose | None, now_ns: int) -> _Plan:
        """Changes the state to blocked if progress is expected but missing."""
        here = None if pose is None else (pose.x_m, pose.y_m, pose.z_m)
        # progress is a distance, because a vehicle that oscillates in front of an obstacle has a speed, too
        min_m = _STILL_M_S * self._config.blocked_s
        moves = here is not None and (self._moved_from is None or math.dist(here, self._moved_from) > min_m)
        if moves or not plan.blockable:
            self._moved_ns, self._moved_from = now_ns, here
        if not plan.blockable or plan.distance_m < self._nearest_m - min_m:
            self._nearest_m, self._nearest_ns = plan.distance_m, now_ns
        strays = now_ns - self._nearest_ns > _STRAYS * self._config.blocked_s * 1e9
        if strays and pose is not None and self._plans_again(pose, now_ns):
            return msgspec.structs.replace(plan, note="plans a detour")
        if now_ns - self._moved_ns > self._config.blocked_s * 1e9:
            if pose is not None and self._plans_again(pose, now_ns):
                return msgspec.structs.replace(plan, note="plans a detour")
            return msgspec.structs.replace(plan, state=NavState.BLOCKED, error=NavError.NO_WAY)
        return plan

    def _plans_again(self, pose: Pose, now_ns: int) -> bool:
        """Searches a route around the seen obstacles, once per goal; returns False if there is no route."""
        goal = self._goal
        if (
            self._replanned
            or goal is None
            or goal.kind is not GoalKind.GOTO
            or self._controller.circle_m > 0.0
        ):
            return False
        if self._search is None:
            width_m = self._config.dwa.radius_m + self._config.dwa.margin_m + _ROOM_M
            occupied = self._seen.occupied(width_m)
            self._search = RouteSearch((pose.x_m, pose.y_m), (goal.x_m, goal.y_m), occupied)
        route = self._search.advance()
        if route is None and not self._search.done:
            return True
        self._search, self._replanned = None, True
        if route is None or len(route) < 2:
            return False  # no route, or a straight one, so something else stops the vehicle
        self._route, self._moved_ns = route, now_ns
        return True

    def _report(self, plan: _Plan, now_ns: int) -> NavStatus | None:
        status = NavStatus(
            self._goal.seq if self._goal else 0,
            plan.state,
            round(plan.distance_m, 3),
            round(plan.error_m, 3),
            plan.note,
            plan.error,
            self._controller.circle_m,
        )
        changed = _published_at_once(status) != _published_at_once(self._status)
        # 1 % early, so that jitter of the steps does not skip a status
        if not changed and now_ns - self._status_ns < 0.99e9 / self._config.status_hz:
            return None
        self._status, self._status_ns = status, now_ns
        return status


def _scan_age_s(delay_ns: int) -> float:
    """Maximum age of used echoes; without them a delayed vehicle would ignore the obstacles."""
    return _SCAN_AGE_S + TURNS * delay_ns / 1e9


def _published_at_once(status: NavStatus) -> object:
    """Fields of a status whose change is published at once, not at the next period."""
    return status.goal_seq, status.state, status.error, status.note
