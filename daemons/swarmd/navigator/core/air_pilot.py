"""The pilot of a vehicle that flies: velocity towards the place, bent around what is in the way."""

import math
from typing import Final

from swarmd.navigator.config import Config
from swarmd.navigator.core.altitude import AltitudeHold
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.types.vehicle import Pose, Setpoint

Vector = tuple[float, float, float]

_DIRECTIONS: Final = 16
_SPEEDS: Final = (1.0, 0.6, 0.25)
_RIGHT: Final = 0.02
"""m/s by which passing on the right is preferred: two that meet must not choose the same side of the map."""
_URGENT: Final = 6.0
"""m/s · s: how much detour a meeting one second ahead is worth."""
_YIELDING: Final = 0.7
"""Share of separation and horizon kept from one that gives way."""
_LEAST_M_S: Final = 0.8
"""Speed of an evading vehicle that would rather stand."""
_CLIMBS_M_S: Final = (0.0, 0.8, -0.8)


class AirPilot:
    """Velocity set-points from a target, in three dimensions."""

    __slots__ = ("_altitude", "_config", "_last_ns", "free")

    flies = True

    def __init__(self, config: Config) -> None:
        self._config = config
        self._altitude = AltitudeHold(config.altitude)
        self._last_ns = 0
        self.free = True
        """Always: there is a way around in the air."""

    def set_config(self, config: Config) -> None:
        """New gains."""
        self._config = config
        self._altitude.set_gains(config.altitude)

    def stop(self) -> Setpoint:
        """Stand still in the air."""
        self._altitude.reset()
        return Setpoint(0.0)

    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint:
        """The set-point for now."""
        air = self._config.air
        dt_s = min(max((now_ns - self._last_ns) / 1e9, 0.0), 0.2)
        self._last_ns = now_ns
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        speed = min(air.kp_1_s * distance, math.sqrt(2 * 0.5 * air.a_max_m_s2 * distance), target.speed_m_s)
        scale = speed / distance if distance > 1e-9 else 0.0
        vx, vy = target.velocity_m_s[0] + dx * scale, target.velocity_m_s[1] + dy * scale
        over = math.hypot(vx, vy) / air.v_max_m_s
        if over > 1:
            vx, vy = vx / over, vy / over
        most, least = min(air.climb_max_m_s, target.climb_m_s), -min(air.sink_max_m_s, target.climb_m_s)
        climb = self._altitude.climb_m_s(target.z_m, pose.z_m, pose.vz_m_s, most, least, dt_s)
        wanted = (vx, vy, climb + target.velocity_m_s[2])
        return self.body(pose, avoid(self._config, pose, wanted, around), target.yaw_rad)

    def body(self, pose: Pose, velocity: Vector, yaw_rad: float | None) -> Setpoint:
        """A velocity of the map as a set-point of the body."""
        air = self._config.air
        yaw = pose.yaw_rad
        wrong = 0.0 if yaw_rad is None else math.remainder(yaw_rad - yaw, math.tau)
        w = min(max(air.yaw_kp_1_s * wrong, -air.w_max_rad_s), air.w_max_rad_s)
        cos, sin = math.cos(yaw), math.sin(yaw)
        vx, vy, vz = velocity
        return Setpoint(vx * cos + vy * sin, vy * cos - vx * sin, vz, w)


def avoid(config: Config, pose: Pose, wanted: Vector, around: Surroundings) -> Vector:
    """The velocity nearest to the wanted one that meets nothing soon.

    Candidates are only tried when the wanted velocity leads to a meeting.
    """
    threats = _threats(config, pose, around)
    if not threats or math.isinf(_meeting_s(threats, wanted)):
        return wanted
    best, best_cost = wanted, math.inf
    for candidate in _candidates(config, wanted):
        detour = math.dist(candidate, wanted)
        cross = wanted[0] * candidate[1] - wanted[1] * candidate[0]
        meeting_s = _meeting_s(threats, candidate)
        price = detour + (_RIGHT if cross > 0 else 0.0)
        if not math.isinf(meeting_s):
            price += _URGENT / max(meeting_s, 0.05)
        if price < best_cost:
            best, best_cost = candidate, price
    return best


def _candidates(config: Config, wanted: Vector) -> list[Vector]:
    air = config.air
    speed = max(math.hypot(wanted[0], wanted[1]), _LEAST_M_S)
    heading = math.atan2(wanted[1], wanted[0])
    found = [wanted]
    for more in _CLIMBS_M_S:
        climb = min(max(wanted[2] + more, -air.sink_max_m_s), air.climb_max_m_s)
        found.append((0.0, 0.0, climb))
        for share in _SPEEDS:
            for i in range(_DIRECTIONS):
                angle = heading + i * math.tau / _DIRECTIONS
                found.append((speed * share * math.cos(angle), speed * share * math.sin(angle), climb))
    return found


_Threat = tuple[float, float, float, float, float, float, float, float]
"""Where it is, seen from here; its velocity; radius to stay out of; how far ahead that counts."""


def _threats(config: Config, pose: Pose, around: Surroundings) -> list[_Threat]:
    air = config.air
    reach = 2 * air.v_max_m_s * air.horizon_s
    found: list[_Threat] = []
    for n in around.neighbours:
        dx, dy, dz = n.x_m - pose.x_m, n.y_m - pose.y_m, n.z_m - pose.z_m
        if max(abs(dx), abs(dy), abs(dz)) < reach:
            share = _YIELDING if n.yields else 1.0
            radius, horizon = air.separation_m * share, air.horizon_s * share
            found.append((dx, dy, dz, n.vx_m_s, n.vy_m_s, n.vz_m_s, radius, horizon))
    for x, y in around.points_m:
        found.append((x - pose.x_m, y - pose.y_m, math.nan, 0.0, 0.0, 0.0, air.obstacle_m, air.horizon_s))
    return found


def _meeting_s(threats: list[_Threat], velocity: Vector) -> float:
    """Time until the first threat comes closer than its radius; infinite when none does that counts.

    What stands (height not a number) is as high as the sky. Who is too close already counts while
    the distance shrinks.
    """
    soonest = math.inf
    vx, vy, vz = velocity
    for dx, dy, dz, ox, oy, oz, radius, horizon in threats:
        rx, ry, rz = vx - ox, vy - oy, vz - oz
        if math.isnan(dz):
            dz = rz = 0.0  # noqa: PLW2901  # an upright thing: only what happens on the map counts
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
