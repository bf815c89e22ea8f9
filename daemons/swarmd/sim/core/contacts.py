"""Detection of contacts with other platforms, and of the earliest possible next contact."""

import math
from typing import Final

from swarmware.types.navigation import Collision
from swarmware.types.vehicle import Pose

_AGE_S: Final = 1.0
"""Maximum age of the pose of another platform in a check."""
_ACCELERATION_M_S2: Final = 20.0
"""Maximum acceleration of two vehicles towards each other: a fall, plus twice the largest of a model."""
_MARGIN_M: Final = 0.5
"""Maximum jump of an estimated pose."""


class Contacts:
    """Tracks the platforms near one vehicle, and detects when the vehicle touches one of them."""

    def __init__(self, radius_m: float) -> None:
        self._distance_m = 2 * radius_m
        """Distance of the centres at a contact, assuming that the other vehicle has the same size."""
        self._near: dict[str, tuple[Pose, int]] = {}
        self._touched: set[str] = set()
        self._clear_ns: dict[str, int] = {}
        """Instant by platform before which a contact is impossible."""

    def __bool__(self) -> bool:
        return bool(self._near)

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        """Takes the pose of another platform, stamped in the own clock."""
        self._near[platform] = (pose, stamp_ns)
        self._clear_ns.pop(platform, None)

    def is_clear(self, platform: str, now_ns: int) -> bool:
        """True if a platform is so far away that a contact is not yet possible."""
        return now_ns < self._clear_ns.get(platform, now_ns)

    def check(self, pose: Pose, stamp_ns: int) -> list[str]:
        """Returns the platforms with a new contact, with the vehicle at this pose and instant."""
        begun = []
        for platform, (other, other_ns) in list(self._near.items()):
            # skips most pairs of a swarm, which are far apart
            if stamp_ns < self._clear_ns.get(platform, stamp_ns):
                continue
            age_s = (stamp_ns - other_ns) / 1e9
            if age_s > _AGE_S:
                del self._near[platform]
                self._clear_ns.pop(platform, None)
                self._touched.discard(platform)
                continue
            gap_m = math.dist(
                (pose.x_m, pose.y_m, pose.z_m),
                (
                    other.x_m + other.vx_m_s * age_s,
                    other.y_m + other.vy_m_s * age_s,
                    other.z_m + other.vz_m_s * age_s,
                ),
            )
            if gap_m >= self._distance_m:
                self._touched.discard(platform)
                clear_s = min(self._clear_s(gap_m, pose, other), _AGE_S - age_s)
                self._clear_ns[platform] = stamp_ns + round(clear_s * 1e9)
            # a lasting contact is reported once
            elif platform not in self._touched:
                self._touched.add(platform)
                begun.append(platform)
        return begun

    def _clear_s(self, gap_m: float, pose: Pose, other: Pose) -> float:
        """Time that two vehicles need to meet at full acceleration, from their present speeds.

        The sum of the speeds counts, not the relative speed, because each may stop at once at an obstacle.
        """
        free_m = gap_m - self._distance_m - _MARGIN_M
        if free_m <= 0.0:
            return 0.0
        speed = math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s) + math.hypot(
            other.vx_m_s, other.vy_m_s, other.vz_m_s
        )
        accel = _ACCELERATION_M_S2
        return (math.sqrt(speed * speed + 2 * accel * free_m) - speed) / accel


def collision(other: str, pose: Pose, speed_m_s: float) -> Collision:
    """Creates the report of a collision at a pose."""
    return Collision(other, round(pose.x_m, 3), round(pose.y_m, 3), round(pose.z_m, 3), round(speed_m_s, 3))
