"""Detector of rest from inertial samples, independent of bias and tilt of the unit."""

import math
from typing import Final

from swarmware.types.vehicle import Imu

_FAST_S: Final = 0.06
"""Time constant of the low-pass that detects a jolt; 1 m/s² at 25 Hz is detected within two samples."""
_SLOW_S: Final = 2.0
"""Time constant of the mean that absorbs bias and tilt."""
_QUIET_NS: Final = 1_000_000_000
"""Time without a jolt after which the vehicle is at rest."""


class Standstill:
    """Zero-velocity detector, for a specific force near its mean and a small rate of turn.

    Source: Skog et al. 2010, "Zero-velocity detection", IEEE Trans. Biomed. Eng. 57.
    """

    __slots__ = ("_accel_m_s2", "_count", "_fast", "_gyro_rad_s", "_quiet_ns", "_slow", "_stamp_ns", "_turn")

    def __init__(self, accel_m_s2: float, gyro_rad_s: float) -> None:
        self._accel_m_s2 = accel_m_s2
        self._gyro_rad_s = gyro_rad_s
        self._fast = self._slow = self._turn = (0.0, 0.0, 0.0)
        self._count = 0
        self._stamp_ns = self._quiet_ns = 0

    def on_imu(self, imu: Imu, stamp_ns: int, dt_s: float) -> None:
        """Takes a sample, `dt_s` after the previous sample."""
        self._stamp_ns = stamp_ns
        force = (imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2)
        rate = (imu.wx_rad_s, imu.wy_rad_s, imu.wz_rad_s)
        self._count += 1
        if self._count == 1:
            self._fast = self._slow = force
            self._turn = rate
            self._quiet_ns = stamp_ns
            return
        soon = dt_s / (dt_s + _FAST_S)
        self._fast = _mixed(self._fast, force, soon)
        self._turn = _mixed(self._turn, rate, soon)
        # a plain mean at first, until the slow filter has settled
        self._slow = _mixed(self._slow, force, max(dt_s / (dt_s + _SLOW_S), 1 / self._count))
        if math.dist(self._fast, self._slow) > self._accel_m_s2 or math.hypot(*self._turn) > self._gyro_rad_s:
            self._quiet_ns = stamp_ns

    @property
    def since_ns(self) -> int:
        """Stamp of the last sample with a jolt."""
        return self._quiet_ns

    @property
    def rests(self) -> bool:
        """True if the last jolt is long enough ago."""
        return self._count > 0 and self._stamp_ns - self._quiet_ns >= _QUIET_NS


def _mixed(
    old: tuple[float, float, float], new: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    return (
        old[0] + (new[0] - old[0]) * share,
        old[1] + (new[1] - old[1]) * share,
        old[2] + (new[2] - old[2]) * share,
    )
