"""Filter for position and velocity, from accelerations, fixes and the sonar's height."""

import math
from typing import Final

from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GNSS_HEIGHT_RATIO, GRAVITY_M_S2, ORIGIN_ACC_M, LocalMap, Origin
from swarmware.geometry.kalman_axis import KalmanAxis
from swarmware.types.vehicle import GnssFix

_ACCEL_SIGMA_M_S2: Final = 0.5
"""Standard deviation of one acceleration at 100 Hz, from the sensor and a tilt error of some degrees."""
_HEIGHT_SIGMA_M: Final = 0.05
"""Standard deviation of a height of the sonar, after the median filter."""
_HEIGHT_GATE_M: Final = 0.5
"""Innovation above which the sonar measures an object, and not the ground below the fixes."""
_HEIGHT_GATE_SIGMAS: Final = 3.0
"""Gate in standard deviations of the estimate, which exceeds `_HEIGHT_GATE_M` after a gap."""
_GAP_SIGMA_M_S2: Final = 1.5
"""Standard deviation of the acceleration in a gap without samples, as for a tilt error of about 9°."""
_LATE_MAX_S: Final = 0.5
"""Maximum age of a fix for which the motion since the fix is added."""


class MotionFilter:
    """Kalman filter with position and velocity for each axis.

    The origin is the first fix with a height and an error of at most `origin_acc_m`; before this fix the
    state is unknown.
    """

    __slots__ = ("_axes", "_height_m", "_map", "_origin_acc_m", "_velocity_m_s", "fix_ns")

    def __init__(self, origin_acc_m: float = ORIGIN_ACC_M) -> None:
        self._origin_acc_m = origin_acc_m
        self._axes: tuple[KalmanAxis, KalmanAxis, KalmanAxis] | None = None
        self._map: LocalMap | None = None
        self._height_m = 0.0
        self._velocity_m_s: Vector = (0.0, 0.0, 0.0)
        """Velocity at the first fix."""
        self.fix_ns = -(1 << 62)
        """Stamp of the newest fix."""

    def begin(self, height_m: float, velocity_m_s: Vector) -> None:
        """Begins in flight, with this height and velocity at the first fix."""
        self._height_m, self._velocity_m_s = height_m, velocity_m_s

    def on_gap(self, gap_s: float) -> None:
        """Widens the uncertainty after a time without accelerations, so that fixes and heights dominate."""
        for axis in self._axes or ():
            axis.widen(_GAP_SIGMA_M_S2, gap_s)

    @property
    def velocity_m_s(self) -> Vector:
        """Velocity in the map, zero before the first fix."""
        axes = self._axes
        return (0.0, 0.0, 0.0) if axes is None else (axes[0].v, axes[1].v, axes[2].v)

    @property
    def position_m(self) -> Vector:
        """Position relative to the origin."""
        axes = self._axes
        return (0.0, 0.0, 0.0) if axes is None else (axes[0].p, axes[1].p, axes[2].p)

    def predict(self, force_m_s2: Vector, dt_s: float, *, landed: bool) -> None:
        """Predicts the state from the specific force in map coordinates; a landed vehicle is at rest."""
        axes = self._axes
        if axes is None:
            return
        x, y, z = axes
        if landed:
            # without this the noise of the accelerometer would be integrated on the ground
            x.v = y.v = z.v = 0.0
            return
        x.predict(force_m_s2[0], dt_s)
        y.predict(force_m_s2[1], dt_s)
        z.predict(force_m_s2[2] - GRAVITY_M_S2, dt_s)

    def on_fix(self, fix: GnssFix, stamp_ns: int, now_ns: int) -> None:
        """Takes a position fix; a two-dimensional fix corrects the horizontal axes only."""
        if stamp_ns <= self.fix_ns or not fix.has_place:
            return
        self.fix_ns = stamp_ns
        sigma_m = fix.sigma_m
        if self._map is None or self._axes is None:
            if not fix.has_height or sigma_m > self._origin_acc_m:
                return
            # in flight the origin lies below the first fix, by the height that was handed over
            alt_m = fix.alt_ellipsoid_m - self._height_m
            origin = Origin(lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_ellipsoid_m=alt_m)
            self._map = LocalMap(origin)
            sigmas = (sigma_m, sigma_m, sigma_m * GNSS_HEIGHT_RATIO)
            x, y, z = (KalmanAxis(0.0, sigma, _ACCEL_SIGMA_M_S2) for sigma in sigmas)
            z.p = self._height_m
            x.v, y.v, z.v = self._velocity_m_s
            self._axes = x, y, z
            return
        # a fix is old when it arrives; the vehicle has moved on since
        late_s = min(max((now_ns - stamp_ns) / 1e9, 0.0), _LATE_MAX_S)
        place = self._map.to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m)
        for axis, measured, ratio in zip(self._axes, place, (1.0, 1.0, GNSS_HEIGHT_RATIO), strict=True):
            axis.update(measured + axis.v * late_s, sigma_m * ratio)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground, after outlier rejection."""
        if self._axes is None:
            return
        axis = self._axes[2]
        if abs(height_m - axis.p) < max(_HEIGHT_GATE_M, _HEIGHT_GATE_SIGMAS * math.sqrt(axis.pp)):
            axis.update(height_m, _HEIGHT_SIGMA_M)
