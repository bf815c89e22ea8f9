"""The newest states of a vehicle, and the conditions by which they show that a command was executed."""

import math
from collections.abc import Callable
from typing import Final

import msgspec

from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionState
from swarmware.types.navigation import NavState, NavStatus
from swarmware.types.vehicle import Pose, VehicleState

STANDING: Final = frozenset({NavState.HOLDING, NavState.ARRIVED, NavState.IDLE})
"""States of a navigator that holds its position."""
STILL_M_S: Final = 0.5
"""Speed below which a vehicle counts as holding: wind and noise cause small motions."""
NEAR_M: Final = 1.0
"""Distance from a commanded place within which a vehicle has arrived."""
CIRCLE_RATIO: Final = 0.1
"""Distance from its circle over the radius within which a vehicle that cannot stop is on it; the navigator's
own is 0.06."""
CIRCLING_HEIGHT_M: Final = 3.0
"""Error of the height within which such a vehicle has climbed to its altitude; the navigator's own is 2 m."""
APPROACH_RATIO: Final = 4.0
"""Distance over the same radius within which such a vehicle has returned: it lands beside its circle."""
HOME_M: Final = 3.0
"""Distance from the place of arming within which a vehicle has returned: the drift of GNSS."""


class VehicleSnapshot(msgspec.Struct, frozen=True):
    """Newest states of one vehicle."""

    kind: PlatformKind
    mission: MissionState | None
    vehicle: VehicleState | None
    nav: NavStatus | None
    pose: Pose | None
    home: Pose | None
    mission_ns: int = 0
    """Stamp of the state of its mission, on its hardware clock."""
    states_ns: int = 0
    """Oldest stamp among its state, its navigator's and its pose, on the same clock."""

    @property
    def speed_m_s(self) -> float:
        """Speed over the ground and vertically; infinite without a pose."""
        pose = self.pose
        return math.inf if pose is None else math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s)

    @property
    def held_by(self) -> str:
        """Operator or pilot that drives the vehicle by hand, or "" in other modes."""
        return self.mission.held_by if self.mission else ""

    @property
    def from_home_m(self) -> float | None:
        """Horizontal distance from the place of arming, or None if unknown."""
        if self.pose is None or self.home is None:
            return None
        return math.hypot(self.pose.x_m - self.home.x_m, self.pose.y_m - self.home.y_m)

    @property
    def circle_m(self) -> float:
        """Radius of the circle on which the vehicle keeps a place, or 0 if it can stop there."""
        return self.nav.circle_m if self.nav is not None else 0.0

    @property
    def near_m(self) -> float:
        """Distance from a place, or from the circle around it, within which it has arrived."""
        return NEAR_M + CIRCLE_RATIO * self.circle_m

    @property
    def settled(self) -> bool:
        """Whether it has stopped, or circles and cannot do more."""
        if self.circle_m > 0.0:
            return self.nav is not None and self.nav.state in STANDING
        return self.speed_m_s < STILL_M_S

    @property
    def standing(self) -> bool:
        """Whether it keeps its position, on the ground or in the air."""
        if self.vehicle is None:
            return False
        # a ground vehicle always counts as landed, so only its speed shows whether it keeps its position
        if self.kind == PlatformKind.UAV and self.vehicle.landed:
            return True
        return self.nav is not None and self.nav.state in STANDING and self.settled

    def away_m(self, x_m: float, y_m: float, z_m: float | None) -> float:
        """Distance from a place, or from the circle around it; without a height only the horizontal one."""
        if self.pose is None:
            return math.inf
        flat_m = abs(math.hypot(self.pose.x_m - x_m, self.pose.y_m - y_m) - self.circle_m)
        return math.hypot(flat_m, 0.0 if z_m is None else self.pose.z_m - z_m)

    @property
    def grounded(self) -> bool:
        """Whether it is on the ground, stopped and disarmed."""
        vehicle = self.vehicle
        if vehicle is None or vehicle.armed or not vehicle.landed:
            return False
        # a disarmed ground vehicle may still roll
        return self.kind == PlatformKind.UAV or self.speed_m_s < STILL_M_S

    def words(self) -> str:
        """Short description: `landed 0.0 m disarmed`."""
        if self.vehicle is None:
            return "unknown"
        if self.kind == PlatformKind.UAV:
            holding = "circling" if self.circle_m > 0.0 else "holding"
            doing = "landed" if self.vehicle.landed else holding if self.standing else "flying"
            if not self.vehicle.armed and not self.vehicle.landed:
                doing = "falling"
        elif self.pose is None:
            doing = "somewhere"
        else:
            doing = "stopped" if self.speed_m_s < STILL_M_S else "moving"
        # noise of a vehicle on the ground would show as a negative height
        height = "" if self.pose is None else f" {max(self.pose.z_m, 0.0):.1f} m"
        return f"{doing}{height} {'armed' if self.vehicle.armed else 'disarmed'}"


Done = Callable[[VehicleSnapshot], bool]
"""Whether the state of a vehicle shows that the command was executed."""


def returned(snapshot: VehicleSnapshot) -> bool:
    """Whether the vehicle has landed where it was armed."""
    away_m = snapshot.from_home_m
    return snapshot.grounded and (away_m is None or away_m <= max(HOME_M, APPROACH_RATIO * snapshot.circle_m))


def risen_to(altitude_m: float) -> Done:
    """Whether the vehicle holds at this altitude, or above it."""

    def done(snapshot: VehicleSnapshot) -> bool:
        vehicle, pose = snapshot.vehicle, snapshot.pose
        if vehicle is None or pose is None or vehicle.landed or not vehicle.armed:
            return False
        near_m = NEAR_M if snapshot.circle_m == 0.0 else CIRCLING_HEIGHT_M
        return pose.z_m >= altitude_m - near_m and snapshot.settled

    return done


def arrived_at(x_m: float, y_m: float, z_m: float | None) -> Done:
    """Whether the vehicle stands at this place, or circles around it; without a height at any."""
    return lambda snapshot: snapshot.settled and snapshot.away_m(x_m, y_m, z_m) < snapshot.near_m


BUILT_IN: Final[dict[str, Done]] = {
    "land": lambda snapshot: snapshot.grounded,
    "hold": lambda snapshot: snapshot.standing,
    "return": returned,
}
"""Condition that holds after each built-in mission."""
