"""Registers of the inertial units MPU-6000 to ICM-20602, which differ only in their chip number."""

import math
import struct
from typing import TYPE_CHECKING, Final

from swarmware.errors import WireError
from swarmware.types.vehicle import Imu

if TYPE_CHECKING:
    from swarmd.hal.config import Axis

ID: Final = 0x75
CHIPS: Final = {
    0x12: "ICM-20602",
    0x68: "MPU-6000",
    0x70: "MPU-6500",
    0x71: "MPU-9250",
    0x73: "MPU-9255",
    0xAF: "ICM-20608",
}
"""Chips by the content of the register `ID`; the MPU-6050 has the number of the MPU-6000."""
DATA: Final = 0x3B
DATA_BYTES: Final = 14
SETTLING_NS: Final = 100_000_000
"""Settling time of the gyroscope after the wake-up; 35 to 100 ms in the data sheets."""
_WAKE: Final = (0x6B, 0x01)
"""Register PWR_MGMT_1: wake up, and use the clock of the gyroscope."""
_FILTER: Final = (0x1A, 0x03)
_ACCELERATION_FILTER: Final = (0x1D, 0x03)
"""Registers of the low-pass filters: 41 to 44 Hz for gyroscope and accelerometer, 1 kHz inside."""
_GYRO_RANGE: Final = (0x1B, 0x18)
_ACCELERATION_RANGE: Final = (0x1C, 0x18)
"""Registers of the ranges: ±2000 °/s and ±16 g."""
SETTINGS: Final = (_WAKE, _FILTER, _ACCELERATION_FILTER, _GYRO_RANGE, _ACCELERATION_RANGE)
"""Registers with their contents, in the order in which they are written."""
_FORM: Final = struct.Struct(">7h")
_RAD_S: Final = math.radians(1) / 16.4
_M_S2: Final = 9.80665 / 2048
"""Scale per LSB at the configured ranges. Source: ICM-20602 register map 1.0; MPU-6000 register map 4.2."""

Axes = tuple["Axis", "Axis", "Axis"]


def measurement(data: bytes, axes: Axes) -> Imu:
    """Decodes rates and forces in the body frame, FLU.

    `axes`: axes of the chip that point forward, left and up. Raises: WireError when the device is silent.
    """
    if len(data) != DATA_BYTES:
        raise WireError(f"{len(data)} bytes, expected {DATA_BYTES}")
    if len(set(data)) == 1:
        raise WireError(f"all bytes are {data[0]:#04x}: asleep, or not connected")
    # the fourth value is the temperature of the chip
    ax, ay, az, _, wx, wy, wz = _FORM.unpack(data)
    rates = mounted((wx * _RAD_S, wy * _RAD_S, wz * _RAD_S), axes)
    return Imu(*rates, *mounted((ax * _M_S2, ay * _M_S2, az * _M_S2), axes))


def mounted(vector: tuple[float, float, float], axes: Axes) -> tuple[float, float, float]:
    """Rotates a vector from the axes of the chip to the body frame."""
    along = dict(zip("xyz", vector, strict=True))
    forward, left, up = (-along[axis[1]] if len(axis) == 2 else along[axis] for axis in axes)
    return forward, left, up


def is_right_handed(axes: Axes) -> bool:
    """True if the axes are distinct and right-handed."""
    units = [mounted(unit, axes) for unit in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    (a, b, c), (d, e, f), (g, h, i) = units
    # the determinant is 1 for a rotation, -1 for a mirror image and 0 for repeated axes
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) == 1.0
