"""Complementary filter, which estimates the attitude from gyro, accelerometer and compass."""

import math
from typing import Final

from swarmware.geometry.attitude import (
    LEVEL,
    Vector,
    from_euler,
    matrix,
    to_body,
    to_euler,
    to_map,
    turned,
)
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Imu

_UP_KP_1_S: Final = 0.2
"""Gain of the correction by the accelerometer in flight, the inverse of its time constant."""
_REST_KP_1_S: Final = 2.0
"""Gain of the correction by the accelerometer on the ground, where it measures gravity only."""
_YAW_KP_1_S: Final = 0.5
"""Gain of the correction by the compass."""
_BIAS_KI_1_S2: Final = 0.01
"""Gain of the estimate of the gyro's bias."""
_BIAS_MAX_RAD_S: Final = 0.1
"""Maximum bias of a MEMS gyro."""
_NONE: Final = (0.0, 0.0, 0.0)
_FORCE_RANGE_M_S2: Final = 3.0
"""Deviation of the specific force from gravity at which the accelerometer's weight reaches 0."""
_ACCEL_RANGE_M_S2: Final = 1.5
"""Commanded horizontal acceleration at which the accelerometer's weight reaches 0."""


class AttitudeFilter:
    """Integrates the gyro, and corrects it slowly by the vertical and by the heading of the compass.

    Source: Mahony, Hamel, Pflimlin 2008, "Nonlinear complementary filters on the special orthogonal group",
    IEEE Trans. Automatic Control 53.
    """

    __slots__ = ("_attitude", "_begun", "_bias", "_rates")

    def __init__(self) -> None:
        self._attitude = LEVEL
        self._bias: Vector = (0.0, 0.0, 0.0)
        self._rates: Vector = (0.0, 0.0, 0.0)
        self._begun = False

    @property
    def rates_rad_s(self) -> Vector:
        """Body rates of the newest sample, without the gyro's bias."""
        return self._rates

    def begin(self, angles_rad: Vector, rates_rad_s: Vector) -> None:
        """Begins with known body rates and a known attitude in roll, pitch and yaw."""
        self._attitude, self._rates, self._begun = from_euler(*angles_rad), rates_rad_s, True

    def angles_rad(self) -> Vector:
        """Estimated attitude in roll, pitch and yaw."""
        return to_euler(self._attitude)

    def to_map(self, vector: Vector) -> Vector:
        """Rotates a vector from body axes to map coordinates."""
        return to_map(matrix(self._attitude), vector)

    def turn_m_s2(self, velocity_m_s: Vector) -> Vector:
        """Centripetal acceleration, in body axes, of a vehicle that turns with constant velocity in body
        axes."""
        (p, q, r), (u, v, w) = self._rates, to_body(matrix(self._attitude), velocity_m_s)
        return q * w - r * v, r * u - p * w, p * v - q * u

    def update(
        self, imu: Imu, dt_s: float, *, landed: bool, accelerates_m_s2: float, turn_m_s2: Vector = _NONE
    ) -> None:
        """Takes a sample of the inertial unit.

        `accelerates_m_s2`: commanded horizontal acceleration; `turn_m_s2`: known acceleration in body axes,
        which is subtracted before the force is used as the vertical.
        """
        force = (imu.ax_m_s2 - turn_m_s2[0], imu.ay_m_s2 - turn_m_s2[1], imu.az_m_s2 - turn_m_s2[2])
        size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        if not self._begun:
            self._begun = True
            roll, pitch = (
                math.atan2(force[1], force[2]),
                math.atan2(-force[0], math.hypot(force[1], force[2])),
            )
            self._attitude = from_euler(roll, pitch, imu.yaw_rad or 0.0)
            return
        up = to_body(matrix(self._attitude), (0.0, 0.0, 1.0))
        gain = _REST_KP_1_S
        if not landed:
            # while the vehicle accelerates, the specific force does not show the vertical
            trust = 1 - abs(size - GRAVITY_M_S2) / _FORCE_RANGE_M_S2 - accelerates_m_s2 / _ACCEL_RANGE_M_S2
            gain = _UP_KP_1_S * max(0.0, trust)
        scale = gain / max(size, 1.0)
        # the cross product of the measured and the estimated vertical is the turn from one to the other
        x = (force[1] * up[2] - force[2] * up[1]) * scale
        y = (force[2] * up[0] - force[0] * up[2]) * scale
        z = (force[0] * up[1] - force[1] * up[0]) * scale
        if imu.yaw_rad is not None:
            # the shortest turn, also across ±180°
            error = math.remainder(imu.yaw_rad - to_euler(self._attitude)[2], math.tau) * _YAW_KP_1_S
            # only about the vertical, so that the compass cannot tilt the attitude
            x, y, z = x + error * up[0], y + error * up[1], z + error * up[2]
        # a correction that persists is a bias of the gyro
        learn = _BIAS_KI_1_S2 * dt_s
        bias = self._bias
        self._bias = (
            _bounded(bias[0] - x * learn),
            _bounded(bias[1] - y * learn),
            _bounded(bias[2] - z * learn),
        )
        bias = self._bias
        self._rates = imu.wx_rad_s - bias[0], imu.wy_rad_s - bias[1], imu.wz_rad_s - bias[2]
        p, q, r = self._rates
        self._attitude = turned(self._attitude, (p + x, q + y, r + z), dt_s)


def _bounded(bias_rad_s: float) -> float:
    return max(-_BIAS_MAX_RAD_S, min(_BIAS_MAX_RAD_S, bias_rad_s))
