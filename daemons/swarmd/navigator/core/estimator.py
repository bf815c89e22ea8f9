"""The state estimator: position and velocity from fixes and accelerations, heading from gyro and compass."""

import math
from typing import Final

from swarmd.navigator.config import Estimator as EstimatorConfig
from swarmd.navigator.core.standstill import Standstill
from swarmware.geodesy import LocalMap, Origin
from swarmware.types.vehicle import GnssFix, Imu, Pose

GRAVITY_M_S2: Final = 9.80665
_HEIGHT_FACTOR: Final = 1.5
"""Heights of a receiver are about this much worse than its positions."""
_FIRST_SPEED_SIGMA_M_S: Final = 0.5
_LONGEST_S: Final = 0.5
"""A longer prediction in one step would be a guess."""
_SLOW_M_S: Final = 0.15
"""A vehicle whose fixes move faster is not at rest: the inertial unit does not feel a steady motion."""
_COMPARED_S: Final = 0.8
"""Least time between the fixes that tell."""
_REST_SIGMA_M_S: Final = 0.05
"""Of the velocity at the end of a rest that a set-point ends."""
_GATE: Final = 3.5
"""A fix so many standard deviations off says that the vehicle has moved."""
_GATE_FIXES: Final = 3
"""So many of them in a row: one may be an outlier."""
_AGAIN_S: Final = 3.0
"""Until the speed is known after the fixes have ended a rest."""
_STEP_M: Final = 0.01
_STEP_RAD: Final = 0.01
"""The pose of a vehicle at rest is stated again if the estimate is this far from it: its error is larger."""


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

    def rest(self, sigma: float) -> None:
        """It stands still from now on, at a place that is not known better than one fix tells it."""
        self.v = self.pv = 0.0
        self.vv = _REST_SIGMA_M_S**2
        self.pp = max(self.pp, sigma * sigma)

    def average(self, measured: float, variance: float) -> None:
        """A measured position of a vehicle at rest."""
        share = self.pp / (self.pp + variance)
        self.p += share * (measured - self.p)
        self.pp *= 1 - share

    def restart(self, measured: float, sigma: float) -> None:
        """It is there, and its speed is unknown."""
        self.p, self.pp = measured, sigma * sigma
        self.v, self.pv, self.vv = 0.0, 0.0, _FIRST_SPEED_SIGMA_M_S**2

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
        "_again_ns",
        "_axes",
        "_compass",
        "_config",
        "_far_fixes",
        "_fix",
        "_fix_ns",
        "_found",
        "_height_m",
        "_height_ns",
        "_imu_ns",
        "_map",
        "_may_rest",
        "_now_ns",
        "_place",
        "_sigmas",
        "_stated",
        "_stated_yaw",
        "_unit",
        "_used_ns",
        "_w",
        "_yaw",
        "at_rest",
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
        self._used_ns = -(1 << 62)
        self._height_m: float | None = None
        self._height_ns = -(1 << 62)
        self._compass: tuple[float, float] | None = None
        self._imu_ns = -(1 << 62)
        self._unit = Standstill(config.rest_accel_m_s2, config.rest_gyro_rad_s)
        self._may_rest = False
        self._again_ns = 0
        self._far_fixes = 0
        self._found = self._sigmas = (0.0, 0.0, 0.0)
        """The newest fix in the map."""
        self._place: tuple[tuple[float, float, float], int] | None = None
        """The first fix that was neither driven nor jolted away from, and its stamp."""
        self._stated: Pose | None = None
        self._stated_yaw = 0.0
        self.at_rest = False
        """Velocity is zero, and the position the average of the fixes (zero-velocity update)."""

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Rates and specific force, of a level body; heading, when the unit has one."""
        if stamp_ns <= self._imu_ns:
            return
        dt_s = min((stamp_ns - self._imu_ns) / 1e9, _LONGEST_S)
        self._imu_ns = stamp_ns
        self._unit.on_imu(imu, stamp_ns, dt_s)
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

    def on_driven(self, driven: bool) -> None:
        """Whether somebody wants it to move, or it is in the air; else it may be at rest."""
        self._may_rest = not driven
        if driven:
            self._place = None

    def predict(self, now_ns: int) -> None:
        """Carry everything to now, then let the measurements correct it."""
        dt_s = (now_ns - self._now_ns) / 1e9
        self._now_ns = now_ns
        self._judge_rest()
        if self._yaw is not None and self._axes is not None and 0.0 < dt_s <= _LONGEST_S and not self.at_rest:
            yaw = self._yaw + self._w * dt_s / 2
            cos, sin = math.cos(yaw), math.sin(yaw)
            forward, left, up = self._accel
            self._axes[0].predict(forward * cos - left * sin, dt_s)
            self._axes[1].predict(forward * sin + left * cos, dt_s)
            self._axes[2].predict(up, dt_s)
            self._yaw = math.remainder(self._yaw + self._w * dt_s, math.tau)
        self._correct()

    def _judge_rest(self) -> None:
        axes = self._axes
        if axes is None:
            return
        quiet = self._unit.rests and self._now_ns - self._imu_ns <= self._config.imu_timeout_s * 1e9
        if self.at_rest:
            if self._may_rest and quiet:
                return
            self.at_rest = False
            if not quiet:  # moved by somebody else: as fast as it may be
                for axis in axes:
                    axis.vv = _FIRST_SPEED_SIGMA_M_S**2
        elif self._may_rest and quiet and self._now_ns >= self._again_ns:
            if not self._stays():
                return
            self.at_rest = True
            self._far_fixes = 0
            self._stated = None
            for axis, sigma in zip(axes, self._sigmas, strict=True):
                axis.rest(sigma)

    def _stays(self) -> bool:
        """Whether the fixes stay at one place; the speed of a filter that takes a slope for an acceleration
        would not say so."""
        if self._place is None:
            return False
        then, then_ns = self._place
        span_s = (self._used_ns - then_ns) / 1e9
        if span_s < _COMPARED_S:
            return False
        way_m = math.dist(then, self._found) - 2 * self._sigmas[0]
        if way_m <= _SLOW_M_S * span_s:
            return True
        self._place = None
        return False

    def _correct(self) -> None:
        if self._compass is not None:
            measured, share = self._compass
            self._compass = None
            if self._yaw is None:
                self._yaw = measured
            # the gyro has carried the heading to now; the compass was read at its stamp
            turned = 0.0 if self.at_rest else self._w * self.since_s(self._imu_ns)
            self._yaw += math.remainder(measured + turned - self._yaw, math.tau) * share
        if self._fix is not None:
            self._correct_position(self._fix)
            self._fix = None
        if self._height_m is not None:
            if self._axes is not None:
                self._correct_height(self._axes[2], self._height_m)
            self._height_m = None

    def _correct_position(self, fix: GnssFix) -> None:
        found = self._found = self._map.to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m)
        sigmas = self._sigmas = (fix.h_acc_m, fix.h_acc_m, fix.h_acc_m * _HEIGHT_FACTOR)
        span_s, self._used_ns = (self._fix_ns - self._used_ns) / 1e9, self._fix_ns
        if self._may_rest and (self._place is None or self._place[1] < self._unit.since_ns):
            self._place = found, self._fix_ns
        axes = self._axes
        if axes is None:
            noise = self._config.accel_sigma_m_s2
            x, y, z = (Axis(p, s, noise) for p, s in zip(found, sigmas, strict=True))
            self._axes = (x, y, z)
            return
        if self.at_rest:
            self._rest_at(axes, found, sigmas, span_s)
            return
        late_s = self.since_s(self._fix_ns)
        for axis, position, sigma in zip(axes, found, sigmas, strict=True):
            axis.update(position + axis.v * late_s, sigma)

    def _rest_at(
        self,
        axes: tuple[Axis, Axis, Axis],
        found: tuple[float, float, float],
        sigmas: tuple[float, float, float],
        span_s: float,
    ) -> None:
        """One fix of a vehicle at rest: averaged, or, with others as far away, the end of the rest."""
        far = any(
            abs(position - axis.p) > _GATE * math.sqrt(axis.pp + sigma * sigma)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True)
        )
        self._far_fixes = self._far_fixes + 1 if far else 0
        if self._far_fixes >= _GATE_FIXES:
            self.at_rest, self._place = False, None
            self._again_ns = self._now_ns + round(_AGAIN_S * 1e9)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True):
                axis.restart(position, sigma)
        elif not far:
            share = self._correlated(span_s)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True):
                axis.average(position, sigma * sigma * share)

    def _correct_height(self, axis: Axis, height_m: float) -> None:
        sigma, span_s = self._config.height_sigma_m, (self._now_ns - self._height_ns) / 1e9
        self._height_ns = self._now_ns
        if self.at_rest:
            axis.average(height_m, sigma * sigma * self._correlated(span_s))
        else:
            axis.update(height_m, sigma)

    def _correlated(self, span_s: float) -> float:
        """How much less a measurement says whose errors are correlated (first-order Gauss-Markov)."""
        return max(1.0, 2 * self._config.gnss_correlation_s / max(span_s, 1e-3))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position, horizontally; infinite before the first fix."""
        return math.inf if self._axes is None else math.sqrt(max(self._axes[0].pp, self._axes[1].pp))

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
        if not self.at_rest:
            return Pose.planar(x.p, y.p, z.p, self._yaw, (x.v, y.v, z.v), self._w)
        stated = self._stated
        if (
            stated is None
            or math.dist((x.p, y.p, z.p), (stated.x_m, stated.y_m, stated.z_m)) > _STEP_M
            or abs(math.remainder(self._yaw - self._stated_yaw, math.tau)) > _STEP_RAD
        ):
            stated = self._stated = Pose.planar(x.p, y.p, z.p, self._yaw)
            self._stated_yaw = self._yaw
        return stated
