"""What vehicles measure, want and do: SI units, ENU world, FLU body (REP-103)."""

import math
import struct
from enum import StrEnum
from typing import Final, Self

import msgspec

from swarmware.errors import WireError
from swarmware.types.bounds import Finite
from swarmware.types.registry import register

_POSE: Final = struct.Struct("<iiihhhhhhhh")
"""Position mm; quaternion x y z w 1/32767; velocity cm/s; yaw rate mrad/s: 28 bytes against about 110."""

_MM: Final = 1000.0
_QUATERNION: Final = 32767.0
_CM: Final = 100.0


def _clip16(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _clip32(value: float) -> int:
    return max(-(2**31), min(2**31 - 1, round(value)))


@register
class Pose(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Position, attitude and velocity in the swarm's map frame."""

    x_m: Finite
    """East."""
    y_m: Finite
    """North."""
    z_m: Finite = 0.0
    """Up, above the map's origin."""
    qx: Finite = 0.0
    qy: Finite = 0.0
    qz: Finite = 0.0
    qw: Finite = 1.0
    """Attitude, FLU body in ENU map, x y z w."""
    vx_m_s: Finite = 0.0
    vy_m_s: Finite = 0.0
    vz_m_s: Finite = 0.0
    """Velocity in the map frame."""
    wz_rad_s: Finite = 0.0
    """Yaw rate, counter-clockwise."""

    @classmethod
    def planar(
        cls,
        x_m: float,
        y_m: float,
        z_m: float = 0.0,
        yaw_rad: float = 0.0,
        velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
        wz_rad_s: float = 0.0,
    ) -> Self:
        """A level pose with this yaw (0 is east, counter-clockwise)."""
        half = yaw_rad / 2
        return cls(x_m, y_m, z_m, 0.0, 0.0, math.sin(half), math.cos(half), *velocity_m_s, wz_rad_s)

    @property
    def yaw_rad(self) -> float:
        """Heading, 0 is east, counter-clockwise."""
        return math.atan2(
            2 * (self.qw * self.qz + self.qx * self.qy), 1 - 2 * (self.qy * self.qy + self.qz * self.qz)
        )

    def pack(self) -> bytes:
        """The quantised form; values beyond its range are clipped to it."""
        return _POSE.pack(
            _clip32(self.x_m * _MM),
            _clip32(self.y_m * _MM),
            _clip32(self.z_m * _MM),
            _clip16(self.qx * _QUATERNION),
            _clip16(self.qy * _QUATERNION),
            _clip16(self.qz * _QUATERNION),
            _clip16(self.qw * _QUATERNION),
            _clip16(self.vx_m_s * _CM),
            _clip16(self.vy_m_s * _CM),
            _clip16(self.vz_m_s * _CM),
            _clip16(self.wz_rad_s * _MM),
        )

    @classmethod
    def unpack(cls, data: bytes | memoryview) -> Self:
        """The pose in the quantised form.

        Raises: WireError when it is none.
        """
        if len(data) != _POSE.size:
            raise WireError(f"packed Pose of {len(data)} bytes: expected {_POSE.size}")
        x, y, z, qx, qy, qz, qw, vx, vy, vz, wz = _POSE.unpack(data)
        return cls(
            x / _MM,
            y / _MM,
            z / _MM,
            qx / _QUATERNION,
            qy / _QUATERNION,
            qz / _QUATERNION,
            qw / _QUATERNION,
            vx / _CM,
            vy / _CM,
            vz / _CM,
            wz / _MM,
        )


@register
class BatteryState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Energy left."""

    voltage_v: Finite
    current_a: Finite
    """Positive: discharging."""
    remaining_ratio: Finite


@register
class GnssFix(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Position from satellites, WGS84."""

    lat_deg: float
    lon_deg: float
    alt_ellipsoid_m: float
    h_acc_m: float
    satellites: int


@register
class Imu(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Body rates and specific force, FLU."""

    wx_rad_s: float
    wy_rad_s: float
    wz_rad_s: float
    ax_m_s2: float
    ay_m_s2: float
    az_m_s2: float
    yaw_rad: float | None = None
    """Heading from its own attitude filter (gyro and compass), 0 is east, counter-clockwise."""


@register
class Range(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A scan of distances, or one (a sonar)."""

    angle_min_rad: float
    angle_step_rad: float
    max_m: float
    ranges_m: tuple[float, ...]


@register
class Setpoint(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What the vehicle shall do now: velocity in the body frame, FLU (REP-147)."""

    vx_m_s: Finite
    vy_m_s: Finite = 0.0
    vz_m_s: Finite = 0.0
    wz_rad_s: Finite = 0.0


@register
class VehicleState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The vehicle's logical state."""

    armed: bool
    landed: bool
    mode: str = "auto"
    """auto | manual."""


@register
class ArmRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Arm or disarm the motors (`sys/vehicle/arm`)."""

    armed: bool


@register
class KillRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Stop the motors now, also in the air, where the vehicle then falls (`sys/vehicle/kill`)."""

    platform: str
    """Name of the vehicle that is meant: a request that went astray stops nobody."""
    reason: str = ""


@register
class MotorOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Audit of one request to the motors (event `vehicle/orders`)."""

    what: str
    """arm | disarm | kill."""
    by: str
    """`operator@gcs` where the connection proved it, else the platform that its frames name."""
    height_m: float
    """Above the map's origin, when it came."""
    reason: str = ""
    refused: str = ""
    """Why it was not done; empty when it was."""


GOAL_KINDS: Final = ("hold", "goto", "takeoff", "land", "formation")
NAV_STATES: Final = ("idle", "moving", "arrived", "holding", "blocked")


class NavError(StrEnum):
    """What keeps a navigator from its goal."""

    NONE = ""
    DISARMED = "disarmed"
    """The motors are off."""
    LEADER_LOST = "leader_lost"
    """No pose of the formation's leader for too long."""
    NO_POSITION = "no_position"
    """It does not know where it is."""
    NO_WAY = "no_way"
    """There should be progress, and there is none."""
    BAD_GOAL = "bad_goal"
    """A goal that this vehicle can never reach."""


@register
class Goal(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What the navigator shall reach or keep: the mission's only wish to it (board `nav/goal`)."""

    seq: int
    """Counts up with each new goal; NavStatus answers with it."""
    kind: str
    """hold | goto | takeoff | land | formation: one of GOAL_KINDS."""
    x_m: Finite = 0.0
    y_m: Finite = 0.0
    z_m: Finite = 0.0
    """goto: where to; takeoff: only the height; land: where it is."""
    yaw_rad: Finite | None = None
    """goto: heading at the end; without it the vehicle arrives as it comes."""
    speed_m_s: Finite = 1.5
    leader: str = ""
    """Formation: platform that leads."""
    offset_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """Formation: my slot seen from the leader, forward, left, up."""
    course: tuple[tuple[Finite, Finite], ...] = ()
    """Formation: waypoints of the leader; every member knows them."""
    advance: bool = False
    """Formation: drive along the course; False: take the slots and stay."""


@register
class NavStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The navigator's answer to the goal (board `nav/status`)."""

    goal_seq: int
    state: str
    """idle | moving | arrived | holding | blocked: one of NAV_STATES."""
    distance_m: Finite = 0.0
    """To the goal; in a formation to the own slot, of an advancing leader to the end of the course."""
    formation_error_m: Finite = 0.0
    note: str = ""
    """For people."""
    error: NavError = NavError.NONE
    """Why it does not get on; a mission decides by it how the motion ends."""


@register
class Collision(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The vehicle touched something (event `sim/collision`)."""

    other: str
    """Obstacle or platform."""
    x_m: float
    y_m: float
    z_m: float
    speed_m_s: float


@register
class DriverStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """How well one driver of the hardware abstraction keeps its period."""

    name: str
    state: str
    """running | waiting (for its device) | failed."""
    asked_hz: float
    real_hz: float
    """Over the last report's interval."""
    worst_late_ms: float
    """Latest start of a read after its due time, over the last report's interval."""
    reads: int
    errors: int
    missed: int = 0
    """Periods that were skipped because a read or the computer was too slow."""
    note: str = ""


@register
class DriverTable(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The drivers of a platform (board `hal/drivers`)."""

    drivers: tuple[DriverStatus, ...] = ()
