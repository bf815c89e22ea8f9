"""Measurements, goals and states of vehicles: SI units, ENU world, FLU body (REP-103)."""

import math
from typing import ClassVar, Final, Self

import msgspec

from swarmware.errors import InvalidInput, WireError
from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite
from swarmware.types.quantised import Form, Part, packer
from swarmware.types.registry import register

_FAR_PARTS: Final = (
    Part("x", "i32", "x_m in mm"),
    Part("y", "i32", "y_m in mm"),
    Part("z", "i32", "z_m in mm"),
)
_NEAR_PARTS: Final = tuple(Part(part.name, "i24", part.meaning) for part in _FAR_PARTS)
_REST_PARTS: Final = (
    Part(
        "attitude_high",
        "u16",
        "upper 16 of the 48 bits of the attitude: bits 45 and 46 are the index of the largest of x, y, z, w,"
        " which is made positive by the sign of all; below are the three others in this order, 15 bits each,"
        " 16384 + √2 · 16383 times the component",
    ),
    Part("attitude_low", "u32", "lower 32 bits of the attitude"),
    Part("vx", "i16", "vx_m_s in cm/s"),
    Part("vy", "i16", "vy_m_s in cm/s"),
    Part("vz", "i16", "vz_m_s in cm/s"),
    Part("wz", "i16", "wz_rad_s in mrad/s"),
)
_REST: Final = packer(_REST_PARTS)
_NEAR_BYTES: Final = 9 + _REST.size
"""Within 8.3 km of the map's origin: 23 bytes against about 110."""
_FAR: Final = packer(_FAR_PARTS)
_FAR_BYTES: Final = _FAR.size + _REST.size
_NEAR_MAX: Final = (1 << 23) - 1

ACCURACY_MIN_M: Final = 0.01
"""Smallest standard deviation that filters use for a fix, typical of a carrier-phase solution."""
ACCURACY_UNKNOWN_M: Final = 15.0
"""Standard deviation of a fix whose receiver states none, typical of a poor sky without corrections."""

_MM: Final = 1000.0
_CM: Final = 100.0
_PART: Final = 16383 * math.sqrt(2)
"""Three components of a unit quaternion beside its largest one are at most 1/√2: 15 bits each."""
_PART_ZERO: Final = 16384
_PART_MASK: Final = 0x7FFF
_UNIT_ERROR: Final = 1e-3


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

    forms: ClassVar[tuple[Form, ...]] = (
        Form(f"{_NEAR_BYTES} bytes: every coordinate fits 24 bits", (*_NEAR_PARTS, *_REST_PARTS)),
        Form(f"{_FAR_BYTES} bytes", (*_FAR_PARTS, *_REST_PARTS)),
    )

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
        """The quantised form; values beyond its range are clipped to it.

        Raises: InvalidInput when the attitude is not a unit quaternion.
        """
        place = (_clip32(self.x_m * _MM), _clip32(self.y_m * _MM), _clip32(self.z_m * _MM))
        if max(place) <= _NEAR_MAX and min(place) >= -_NEAR_MAX:
            head = b"".join([coordinate.to_bytes(3, "little", signed=True) for coordinate in place])
        else:
            head = _FAR.pack(*place)
        attitude = _pack_attitude((self.qx, self.qy, self.qz, self.qw))
        return head + _REST.pack(
            attitude >> 32,
            attitude & 0xFFFF_FFFF,
            _clip16(self.vx_m_s * _CM),
            _clip16(self.vy_m_s * _CM),
            _clip16(self.vz_m_s * _CM),
            _clip16(self.wz_rad_s * _MM),
        )

    @classmethod
    def unpack(cls, data: bytes | memoryview) -> Self:
        """The pose in the quantised form.

        Raises: WireError for any other bytes.
        """
        if len(data) == _NEAR_BYTES:
            x, y, z = (int.from_bytes(data[at : at + 3], "little", signed=True) for at in (0, 3, 6))
        elif len(data) == _FAR_BYTES:
            x, y, z = _FAR.unpack_from(data)
        else:
            raise WireError(f"packed Pose of {len(data)} bytes: expected {_NEAR_BYTES} or {_FAR_BYTES}")
        high, low, vx, vy, vz, wz = _REST.unpack_from(data, len(data) - _REST.size)
        qx, qy, qz, qw = _unpack_attitude(high << 32 | low)
        return cls(x / _MM, y / _MM, z / _MM, qx, qy, qz, qw, vx / _CM, vy / _CM, vz / _CM, wz / _MM)


def _pack_attitude(q: tuple[float, float, float, float]) -> int:
    """Index of the largest component, and the other three; `q` and `-q` are the same attitude."""
    if not abs(sum(part * part for part in q) - 1) < _UNIT_ERROR:
        raise InvalidInput(f"attitude {q}: no unit quaternion")
    largest = max(range(4), key=lambda index: abs(q[index]))
    scale = -_PART if q[largest] < 0 else _PART
    packed = largest
    # The largest is left out, as it follows from the unit length: near 0 the root would lose precision.
    for index in range(4):
        if index != largest:
            part = round(q[index] * scale) + _PART_ZERO
            packed = packed << 15 | max(0, min(_PART_MASK, part))
    return packed


def _unpack_attitude(packed: int) -> list[float]:
    parts = [((packed >> shift & _PART_MASK) - _PART_ZERO) / _PART for shift in (30, 15, 0)]
    largest = math.sqrt(max(0.0, 1 - sum(part * part for part in parts)))
    parts.insert(packed >> 45 & 3, largest)
    return parts


@register
class BatteryState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Voltage, current and remaining charge of the battery."""

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
    """Height above the ellipsoid; NaN in a fix of two dimensions."""
    h_acc_m: float
    """Horizontal standard deviation."""
    satellites: int
    """Number of satellites that were used, or 0 if the receiver does not say."""

    @property
    def has_place(self) -> bool:
        """Whether latitude and longitude are numbers."""
        return math.isfinite(self.lat_deg) and math.isfinite(self.lon_deg)

    @property
    def has_height(self) -> bool:
        """Whether the fix has three dimensions."""
        return math.isfinite(self.alt_ellipsoid_m)

    @property
    def sigma_m(self) -> float:
        """Horizontal standard deviation for filters, at least 0.01 m.

        An accuracy of zero, below zero, NaN or infinite is not stated: it counts as 15 m, never as perfect.
        """
        if not (math.isfinite(self.h_acc_m) and self.h_acc_m > 0.0):
            return ACCURACY_UNKNOWN_M
        return max(self.h_acc_m, ACCURACY_MIN_M)


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
    roll_rad: float | None = None
    """Roll from an attitude filter, or None if the vehicle stays level."""
    pitch_rad: float | None = None
    """Pitch, positive with the nose down, or None as `roll_rad`."""


@register
class Barometer(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Air pressure, and the temperature of the sensor."""

    pressure_pa: Finite
    """Pressure at the vehicle, not reduced to sea level."""
    temperature_degc: Finite


@register
class MotorControllerState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of one motor, as its controller measures it."""

    speed_erpm: Finite
    """Electrical revolutions a minute: the shaft's revolutions times the pairs of poles."""
    current_a: Finite
    """Current of the motor, negative while it brakes."""
    duty_ratio: Finite
    """Part of the voltage of the battery, -1 to 1."""
    voltage_v: Finite | None = None
    """Voltage of the battery at the controller."""
    temperature_degc: Finite | None = None
    """Temperature of the power electronics."""


@register
class Range(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A scan of distances, or one (a sonar)."""

    angle_min_rad: float
    angle_step_rad: float
    max_m: float
    ranges_m: tuple[float, ...]


@register
class Setpoint(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Set-point: velocity in the body frame, FLU (REP-147)."""

    vx_m_s: Finite
    vy_m_s: Finite = 0.0
    vz_m_s: Finite = 0.0
    wz_rad_s: Finite = 0.0


class VehicleMode(OpenEnum):
    """Source of the vehicle's commands."""

    AUTO = "auto"
    MANUAL = "manual"


@register
class VehicleState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The vehicle's logical state."""

    armed: bool
    landed: bool
    mode: VehicleMode = VehicleMode.AUTO
    """auto if the navigator drives; manual if an operator or the safety pilot drives, or it holds
    (`control/state`)."""

    @property
    def resting(self) -> bool:
        """Whether the vehicle is disarmed and on the ground."""
        return self.landed and not self.armed


@register
class ArmRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Arm or disarm the motors (`sys/vehicle/arm`); arming is refused while the vehicle is not ready."""

    armed: bool
    force: bool = False
    """Whether to arm although `health/ready` names items that are not ready; recorded in `vehicle/orders`."""
    reason: str = ""
    """Why it is done, for the records."""


@register
class KillRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Stop the motors now, also in the air, where the vehicle then falls (`sys/vehicle/kill`)."""

    platform: str
    """Name of the vehicle; a request with another name is refused."""
    reason: str = ""


class MotorAction(OpenEnum):
    """Action of a request to the motors."""

    ARM = "arm"
    DISARM = "disarm"
    KILL = "kill"
    CALIBRATE = "calibrate"
    GAINS = "gains"


@register
class MotorOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Audit of one request to the motors (event `vehicle/orders`)."""

    what: MotorAction
    by: str
    """Authenticated sender, `operator@gcs`, else the platform in its frames."""
    height_m: float
    """Height above the map's origin when the request arrived."""
    reason: str = ""
    refused: str = ""
    """Reason of a refusal, or "" if it was executed."""
    overridden: str = ""
    """Items that were not ready when the arming was forced, or "" if nothing was overridden."""
