"""The state estimator: position and velocity from fixes and accelerations, heading from gyro and compass."""

import math
from typing import Final

from swarmd.navigator.config import Estimator as EstimatorConfig
from swarmware.geodesy import LocalMap, Origin
from swarmware.types.vehicle import GnssFix, Imu, Pose

GRAVITY_M_S2: Final = 9.80665
_HEIGHT_FACTOR: Final = 1.5
"""Heights of a receiver are about this much worse than its positions."""
_FIRST_SPEED_SIGMA_M_S: Final = 0.5
_LONGEST_S: Final = 0.5
"""A longer prediction in one step would be a guess."""


class Axis:
    """Kalman filter of one axis: position and velocity, driven by a measured acceleration.

    Units: metres, seconds. The matrix of its own doubt is symmetric: pp, pv, vv.
    """

    __slots__ = ("_noise", "p", "pp", "pv", "v", "vv")

    def __init__(self, position: float, sigma: float, accel_sigma: float) -> None:
        self.p = position
        self.v = 0.0
        self.pp = sigma * sigma
        self.pv = 0.0
        self.vv = _FIRST_SPEED_SIGMA_M_S**2
        self._noise = accel_sigma * accel_sigma

    def predict(self, accel: float, dt_s: float) -> None:
        """On by dt with this acceleration."""
        half = dt_s * dt_s / 2
        self.p += self.v * dt_s + accel * half
        self.v += accel * dt_s
        q = self._noise
        self.pp += dt_s * (2 * self.pv + dt_s * self.vv) + q * half * half
        self.pv += dt_s * self.vv + q * half * dt_s
        self.vv += q * dt_s * dt_s

    def update(self, measured: float, sigma: float) -> None:
        """A measured position."""
        doubt = self.pp + sigma * sigma
        kp, kv = self.pp / doubt, self.pv / doubt
        wrong = measured - self.p
        self.p += kp * wrong
        self.v += kv * wrong
        self.vv -= kv * self.pv
        self.pv *= 1 - kp
        self.pp *= 1 - kp


class Estimator:
    """Where the vehicle is and how it moves; measurements wait until `predict` carries them to now."""

    __slots__ = (
        "_accel",
        "_axes",
        "_compass",
        "_config",
        "_fix",
        "_fix_ns",
        "_height_m",
        "_imu_ns",
        "_map",
        "_now_ns",
        "_w",
        "_yaw",
    )

    def __init__(self, config: EstimatorConfig, origin: Origin) -> None:
        self._config = config
        self._map = LocalMap(origin)
        self._axes: tuple[Axis, Axis, Axis] | None = None
        self._yaw: float | None = None
        self._w = 0.0
        self._accel = (0.0, 0.0, 0.0)
        self._now_ns = 0
        self._fix: GnssFix | None = None
        self._fix_ns = -(1 << 62)
        self._height_m: float | None = None
        self._compass: tuple[float, float] | None = None
        self._imu_ns = -(1 << 62)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Rates and specific force, of a level body; heading, when the unit has one."""
        if stamp_ns <= self._imu_ns:
            return
        dt_s = min((stamp_ns - self._imu_ns) / 1e9, _LONGEST_S)
        self._imu_ns = stamp_ns
        self._w = imu.wz_rad_s
        self._accel = (imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2 - GRAVITY_M_S2)
        if imu.yaw_rad is not None:
            self._compass = (imu.yaw_rad, min(1.0, dt_s / self._config.yaw_tau_s))

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """A position fix."""
        if stamp_ns > self._fix_ns:
            self._fix, self._fix_ns = fix, stamp_ns

    def on_height(self, height_m: float) -> None:
        """Height above the ground, already freed from wrong echoes."""
        self._height_m = height_m

    def on_landed(self) -> None:
        """The vehicle stands on the ground: it does not move, whatever drifts."""
        if self._axes is not None:
            for axis in self._axes:
                axis.v = 0.0

    def predict(self, now_ns: int) -> None:
        """Carry everything to now, then let the measurements correct it."""
        dt_s = (now_ns - self._now_ns) / 1e9
        self._now_ns = now_ns
        if self._yaw is not None and self._axes is not None and 0.0 < dt_s <= _LONGEST_S:
            yaw = self._yaw + self._w * dt_s / 2
            cos, sin = math.cos(yaw), math.sin(yaw)
            forward, left, up = self._accel
            self._axes[0].predict(forward * cos - left * sin, dt_s)
            self._axes[1].predict(forward * sin + left * cos, dt_s)
            self._axes[2].predict(up, dt_s)
            self._yaw = math.remainder(self._yaw + self._w * dt_s, math.tau)
        self._correct()

    def _correct(self) -> None:
        if self._compass is not None:
            measured, share = self._compass
            self._compass = None
            if self._yaw is None:
                self._yaw = measured
            # the gyro has carried the heading to now; the compass was read at its stamp
            wrong = math.remainder(measured + self._w * self.since_s(self._imu_ns) - self._yaw, math.tau)
            self._yaw += wrong * share
        if self._fix is not None:
            self._correct_position(self._fix)
            self._fix = None
        if self._height_m is not None:
            if self._axes is not None:
                self._axes[2].update(self._height_m, self._config.height_sigma_m)
            self._height_m = None

    def _correct_position(self, fix: GnssFix) -> None:
        found = self._map.to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m)
        sigmas = (fix.h_acc_m, fix.h_acc_m, fix.h_acc_m * _HEIGHT_FACTOR)
        if self._axes is None:
            noise = self._config.accel_sigma_m_s2
            x, y, z = (Axis(p, s, noise) for p, s in zip(found, sigmas, strict=True))
            self._axes = (x, y, z)
            return
        late_s = self.since_s(self._fix_ns)
        for axis, position, sigma in zip(self._axes, found, sigmas, strict=True):
            axis.update(position + axis.v * late_s, sigma)

    def since_s(self, stamp_ns: int) -> float:
        """Time from a stamp to the instant of the last `predict`."""
        return min(max((self._now_ns - stamp_ns) / 1e9, 0.0), _LONGEST_S)

    def pose(self) -> Pose | None:
        """The estimate at the instant of the last `predict`; None when there is none to trust."""
        if self._axes is None or self._yaw is None:
            return None
        config, now_ns = self._config, self._now_ns
        if (
            now_ns - self._fix_ns > config.gnss_timeout_s * 1e9
            or now_ns - self._imu_ns > config.imu_timeout_s * 1e9
        ):
            return None
        x, y, z = self._axes
        return Pose.planar(x.p, y.p, z.p, self._yaw, (x.v, y.v, z.v), self._w)
