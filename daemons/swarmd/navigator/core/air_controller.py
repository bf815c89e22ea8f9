"""Controller of an air vehicle, which commands a velocity towards the target and avoids collisions."""

import math
from typing import Final

import msgspec

from swarmd.navigator.config import AltitudeConfig, Config
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.vehicle import Pose, Setpoint

Vector = tuple[float, float, float]

_DIRECTIONS: Final = 16
_SPEEDS: Final = (1.0, 0.6, 0.25)
_LEFT_COST_M_S: Final = 0.02
"""Cost of passing on the left, in m/s, so that two vehicles that meet both turn right."""
_COLLISION_COST: Final = 6.0
"""Cost of a collision, in m/s · s, as the deviation that avoids a collision one second ahead."""
_COST_SPEED_M_S: Final = 6.0
"""Commanded speed above which the cost of a collision grows in proportion, as deviations do."""
_YIELDING_RATIO: Final = 0.7
"""Ratio of separation and horizon that is kept from a vehicle that gives way."""
_EVADE_MIN_M_S: Final = 0.8
"""Minimum speed of an evading vehicle."""
_CLIMBS_M_S: Final = (0.0, 0.8, -0.8)
_FINAL_M: Final = 1.5
"""Height below which a landing vehicle descends at touch-down speed."""
_DEEP_M: Final = 10.0
"""Depth of a landing's target below the vehicle; with a target on the ground it would hover just above it."""


class AltitudeHold:
    """PID controller from height to climb rate; the derivative of the measurement avoids derivative kick."""

    __slots__ = ("_gains", "_integral_m_s")

    def __init__(self, gains: AltitudeConfig) -> None:
        self._gains = gains
        self._integral_m_s = 0.0

    def set_gains(self, gains: AltitudeConfig) -> None:
        """Replaces the gains, also in flight (S2.46)."""
        self._gains = gains

    def reset(self) -> None:
        """Clears the integral, which would wind up on the ground."""
        self._integral_m_s = 0.0

    def climb_m_s(
        self,
        wanted_m: float,
        height_m: float,
        climb_m_s: float,
        max_m_s: float,
        min_m_s: float,
        dt_s: float,
    ) -> float:
        """Commanded climb rate within its limits; the lower limit is negative."""
        gains = self._gains
        error_m = wanted_m - height_m
        unlimited = gains.kp_1_s * error_m + self._integral_m_s - gains.kd * climb_m_s
        answer = min(max(unlimited, min_m_s), max_m_s)
        # anti-windup: the integral grows only while the output is not saturated
        if answer == unlimited or (unlimited - answer) * error_m < 0:
            self._integral_m_s += gains.ki_1_s2 * error_m * dt_s
        return answer


class AirController:
    """Computes velocity set-points towards a target, in three dimensions."""

    __slots__ = ("_altitude", "_config", "_last_ns", "free")

    flies = True
    circle_m: Final = 0.0
    arrive_m: Final = 0.0

    def __init__(self, config: Config) -> None:
        self._config = config
        self._altitude = AltitudeHold(config.altitude)
        self._last_ns = 0
        self.free = True
        """Always True, because in the air there is a way around an obstacle."""

    def set_config(self, config: Config) -> None:
        """Replaces the gains of all control loops."""
        self._config = config
        self._altitude.set_gains(config.altitude)

    def stop(self) -> Setpoint:
        """Set-point of zero velocity; clears the altitude integral."""
        self._altitude.reset()
        return Setpoint(0.0)

    def sink(self, rate_m_s: float) -> Setpoint:
        """Set-point of a descent without a position; clears the altitude integral."""
        self._altitude.reset()
        return Setpoint(0.0, vz_m_s=-rate_m_s)

    def hold_at(self, pose: Pose) -> tuple[float, float]:
        """Position at which the vehicle can stop without overshoot."""
        slip = math.hypot(pose.vx_m_s, pose.vy_m_s) / (2 * self._config.air.a_max_m_s2)
        return pose.x_m + pose.vx_m_s * slip, pose.y_m + pose.vy_m_s * slip

    def descend(self, pose: Pose, stay: Target, speed_m_s: float) -> Target:
        """Target of a landing straight down at the held position."""
        sink = speed_m_s if pose.z_m > _FINAL_M else min(speed_m_s, self._config.air.touch_down_m_s)
        return msgspec.structs.replace(stay, z_m=pose.z_m - _DEEP_M, climb_m_s=sink)

    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint:
        """Computes the set-point of one control step."""
        air = self._config.air
        dt_s = min(max((now_ns - self._last_ns) / 1e9, 0.0), 0.2)
        self._last_ns = now_ns
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        # half the deceleration leaves a reserve, so that the vehicle does not overshoot the target
        speed = min(air.kp_1_s * distance, math.sqrt(2 * 0.5 * air.a_max_m_s2 * distance), target.speed_m_s)
        scale = speed / distance if distance > 1e-9 else 0.0
        vx, vy = target.velocity_m_s[0] + dx * scale, target.velocity_m_s[1] + dy * scale
        over = math.hypot(vx, vy) / air.v_max_m_s
        if over > 1:
            vx, vy = vx / over, vy / over
        climb_max, climb_min = (
            min(air.climb_max_m_s, target.climb_m_s),
            -min(air.sink_max_m_s, target.climb_m_s),
        )
        climb = self._altitude.climb_m_s(target.z_m, pose.z_m, pose.vz_m_s, climb_max, climb_min, dt_s)
        wanted = (vx, vy, climb + target.velocity_m_s[2])
        return self.to_body(pose, avoid(self._config, pose, wanted, around), target.yaw_rad)

    def to_body(self, pose: Pose, velocity: Vector, yaw_rad: float | None) -> Setpoint:
        """Converts a velocity in the map frame to a set-point in the body frame."""
        air = self._config.air
        yaw = pose.yaw_rad
        yaw_error = 0.0 if yaw_rad is None else math.remainder(yaw_rad - yaw, math.tau)
        w = min(max(air.yaw_kp_1_s * yaw_error, -air.w_max_rad_s), air.w_max_rad_s)
        cos, sin = math.cos(yaw), math.sin(yaw)
        vx, vy, vz = velocity
        return Setpoint(vx * cos + vy * sin, vy * cos - vx * sin, vz, w)


def avoid(
    config: Config, pose: Pose, wanted: Vector, around: Surroundings, speeds: tuple[float, ...] = _SPEEDS
) -> Vector:
    """Velocity nearest to the commanded velocity that leads to no collision within the horizon.

    Candidates are tried only if the commanded velocity leads to a collision; `speeds` are the ratios of their
    speeds to the commanded speed. A vehicle that can fly slower may also stop.
    """
    threats = _threats(config, pose, around)
    if not threats or math.isinf(_collision_time_s(threats, wanted)):
        return wanted
    collision_cost = _COLLISION_COST * max(1.0, math.hypot(wanted[0], wanted[1]) / _COST_SPEED_M_S)
    best, best_cost = wanted, math.inf
    for candidate in _candidates(config, wanted, speeds):
        detour = math.dist(candidate, wanted)
        cross = wanted[0] * candidate[1] - wanted[1] * candidate[0]
        meeting_s = _collision_time_s(threats, candidate)
        price = detour + (_LEFT_COST_M_S if cross > 0 else 0.0)
        if not math.isinf(meeting_s):
            # a later collision is cheaper, because the vehicle can still evade in a later step
            price += collision_cost / max(meeting_s, 0.05)
        if price < best_cost:
            best, best_cost = candidate, price
    return best


def _candidates(config: Config, wanted: Vector, speeds: tuple[float, ...]) -> list[Vector]:
    air = config.air
    speed = max(math.hypot(wanted[0], wanted[1]), _EVADE_MIN_M_S)
    heading = math.atan2(wanted[1], wanted[0])
    found = [wanted]
    for more in _CLIMBS_M_S:
        climb = min(max(wanted[2] + more, -air.sink_max_m_s), air.climb_max_m_s)
        # only a vehicle that can fly slower may also stop
        if len(speeds) > 1:
            found.append((0.0, 0.0, climb))
        for share in speeds:
            for i in range(_DIRECTIONS):
                angle = heading + i * math.tau / _DIRECTIONS
                found.append((speed * share * math.cos(angle), speed * share * math.sin(angle), climb))
    return found


_Threat = tuple[float, float, float, float, float, float, float, float]
"""Relative position, velocity, radius to keep free, and horizon in s."""


def _threats(config: Config, pose: Pose, around: Surroundings) -> list[_Threat]:
    air = config.air
    reach = 2 * air.v_max_m_s * air.horizon_s
    found: list[_Threat] = []
    for n in around.neighbours:
        dx, dy, dz = n.x_m - pose.x_m, n.y_m - pose.y_m, n.z_m - pose.z_m
        # two vehicles at full speed towards each other cover twice the own distance
        if max(abs(dx), abs(dy), abs(dz)) < reach:
            share = _YIELDING_RATIO if n.yields else 1.0
            radius, horizon = air.separation_m * share, air.horizon_s * share
            found.append((dx, dy, dz, n.vx_m_s, n.vy_m_s, n.vz_m_s, radius, horizon))
    for x, y in around.points_m:
        found.append((x - pose.x_m, y - pose.y_m, math.nan, 0.0, 0.0, 0.0, air.obstacle_m, air.horizon_s))
    return found


def _collision_time_s(threats: list[_Threat], velocity: Vector) -> float:
    """Time until the first threat is closer than its radius, or infinity without such a threat.

    An obstacle of unknown height (NaN) is infinitely high. A threat that is already too close counts only
    while the distance decreases.
    """
    soonest = math.inf
    vx, vy, vz = velocity
    for dx, dy, dz, ox, oy, oz, radius, horizon in threats:
        rx, ry, rz = vx - ox, vy - oy, vz - oz
        if math.isnan(dz):
            dz = rz = 0.0  # noqa: PLW2901  # infinitely high, so only the horizontal motion counts
        closing = dx * rx + dy * ry + dz * rz
        if closing <= 0.0:
            continue
        gap2 = dx * dx + dy * dy + dz * dz - radius * radius
        if gap2 <= 0.0:
            return 0.0
        speed2 = rx * rx + ry * ry + rz * rz
        root2 = closing * closing - speed2 * gap2
        if root2 <= 0.0:
            continue
        meeting = (closing - math.sqrt(root2)) / speed2
        if meeting <= horizon:
            soonest = min(soonest, meeting)
    return soonest
