"""State estimator, with position and velocity from GNSS fixes and accelerations, heading from gyro and
compass."""

import math
from typing import Final

from swarmd.navigator.config import EstimatorConfig
from swarmd.navigator.core.standstill import Standstill
from swarmware.geometry.attitude import levelled
from swarmware.geometry.geodesy import GNSS_HEIGHT_RATIO, GRAVITY_M_S2, LocalMap, Origin
from swarmware.geometry.kalman_axis import FIRST_SPEED_SIGMA_M_S, SIGMA_MAX_M, KalmanAxis
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

_PREDICTION_MAX_S: Final = 2.0
"""Maximum prediction in one step."""
_HELD_S: Final = 0.25
"""Time for which an inertial measurement holds: the period at rest, which is the longest, and some jitter. An
overloaded node takes one sample of several."""
_UNKNOWN_M_S2: Final = 2.0
"""Standard deviation of an unmeasured acceleration, as of a vehicle that starts or brakes."""
_LATE_MAX_NS: Final = 2_000_000_000
"""Maximum scheduling delay that is subtracted from the age of measurements."""
_SLOW_M_S: Final = 0.15
"""Speed of the fixes above which a vehicle moves, because inertial units do not measure steady motion."""
_REFERENCE_MIN_S: Final = 0.8
"""Minimum time between two fixes that are compared for rest."""
_GATE: Final = 3.5
"""Innovation gate in standard deviations; a fix outside of the gate means that the vehicle has moved."""
_GATE_FIXES: Final = 3
"""Consecutive fixes outside of the gate that end a rest; a single fix may be an outlier."""
_REST_BLOCKED_S: Final = 3.0
"""Time without a new rest after the fixes have ended a rest, until the speed is known."""
_STEP_M: Final = 0.01
_STEP_RAD: Final = 0.01
"""Changes of the estimate above which the pose at rest is changed; the error of the estimate is larger."""
STOP: Final = Setpoint(0.0)


class Estimator:
    """Estimates pose and velocity; measurements are buffered until `predict` applies them.

    A two-dimensional fix corrects the horizontal position only. A ground vehicle then keeps its height; the
    pose of an air vehicle is valid only while heights arrive from fixes or from the sonar.
    """

    __slots__ = (
        "_accel",
        "_axes",
        "_compass",
        "_config",
        "_fix",
        "_fix_ns",
        "_flies",
        "_found",
        "_gated_fixes",
        "_height_m",
        "_height_ns",
        "_imu_ns",
        "_map",
        "_may_rest",
        "_now_ns",
        "_published",
        "_published_yaw",
        "_rest_allowed_ns",
        "_rest_reference",
        "_sigmas",
        "_standstill",
        "_used_ns",
        "_vertical_ns",
        "_w",
        "_yaw",
        "at_rest",
    )

    def __init__(self, config: EstimatorConfig, origin: Origin, *, flies: bool = True) -> None:
        self._config = config
        self._flies = flies
        self._map = LocalMap(origin)
        self._axes: tuple[KalmanAxis, KalmanAxis, KalmanAxis] | None = None
        self._yaw: float | None = None
        self._w = 0.0
        self._accel = (0.0, 0.0, 0.0)
        self._now_ns = 0
        self._fix: GnssFix | None = None
        self._fix_ns = -(1 << 62)
        self._used_ns = -(1 << 62)
        self._height_m: float | None = None
        self._height_ns = -(1 << 62)
        self._vertical_ns = -(1 << 62)
        """Stamp of the newest height from a fix or from the sonar."""
        self._compass: tuple[float, float] | None = None
        self._imu_ns = -(1 << 62)
        self._standstill = Standstill(config.rest_accel_m_s2, config.rest_gyro_rad_s)
        self._may_rest = False
        self._rest_allowed_ns = 0
        self._gated_fixes = 0
        self._found = self._sigmas = (0.0, 0.0, 0.0)
        """The newest fix in map coordinates, and its standard deviations."""
        self._rest_reference: tuple[tuple[float, float, float], int] | None = None
        """Reference for detecting rest: the first fix since the last set-point or jolt, and its stamp."""
        self._published: Pose | None = None
        self._published_yaw = 0.0
        self.at_rest = False
        """True while the velocity is zero and the position the average of the fixes (zero-velocity
        update)."""

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes rates and specific force, and the heading if the unit measures it.

        Without roll and pitch the body counts as level.
        """
        # the same sample read again, or an older one
        if stamp_ns <= self._imu_ns:
            return
        dt_s = min((stamp_ns - self._imu_ns) / 1e9, _PREDICTION_MAX_S)
        self._imu_ns = stamp_ns
        self._standstill.on_imu(imu, stamp_ns, dt_s)
        rate, force = (imu.wx_rad_s, imu.wy_rad_s, imu.wz_rad_s), (imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2)
        if imu.roll_rad is not None and imu.pitch_rad is not None:
            rate, force = (levelled(vector, imu.roll_rad, imu.pitch_rad) for vector in (rate, force))
        self._w = rate[2]
        self._accel = (force[0], force[1], force[2] - GRAVITY_M_S2)
        if imu.yaw_rad is not None:
            # after a long gap the turn since the last sample is unknown, so the compass replaces the heading
            share = 1.0 if dt_s > _HELD_S else min(1.0, dt_s / self._config.yaw_tau_s)
            self._compass = (imu.yaw_rad, share)

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """Takes a position fix."""
        if stamp_ns > self._fix_ns and fix.has_place:
            self._fix, self._fix_ns = fix, stamp_ns

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground, after outlier rejection."""
        self._height_m = height_m

    def on_landed(self) -> None:
        """Sets the velocity of a landed vehicle to zero."""
        if self._axes is not None:
            for axis in self._axes:
                axis.v = 0.0

    def on_driven(self, driven: bool) -> None:
        """Takes whether the vehicle is commanded to move or in the air, when it cannot be at rest."""
        self._may_rest = not driven
        if driven:
            self._rest_reference = None

    def predict(self, now_ns: int) -> None:
        """Predicts the state to the present instant, then corrects it with the buffered measurements."""
        dt_s = min((now_ns - self._now_ns) / 1e9, _PREDICTION_MAX_S)
        self._now_ns = now_ns
        self._update_rest()
        if self._yaw is not None and self._axes is not None and dt_s > 0.0 and not self.at_rest:
            held_s = min(dt_s, _HELD_S)
            # the heading in the middle of the step, so that turns do not bias the velocity
            yaw = self._yaw + self._w * held_s / 2
            cos, sin = math.cos(yaw), math.sin(yaw)
            forward, left, up = self._accel
            self._axes[0].predict(forward * cos - left * sin, held_s)
            self._axes[1].predict(forward * sin + left * cos, held_s)
            self._axes[2].predict(up, held_s)
            if dt_s > held_s:
                for axis in self._axes:
                    axis.predict(0.0, dt_s - held_s, _UNKNOWN_M_S2)
            self._yaw = math.remainder(self._yaw + self._w * dt_s, math.tau)
        self._correct()

    def _update_rest(self) -> None:
        axes = self._axes
        if axes is None:
            return
        quiet = self._standstill.rests and self._now_ns - self._imu_ns <= self._config.imu_timeout_s * 1e9
        if self.at_rest:
            if self._may_rest and quiet:
                return
            self.at_rest = False
            if not quiet:  # moved by an external force, so the speed is unknown
                for axis in axes:
                    # a large variance lets the next fixes decide about the speed
                    axis.vv = FIRST_SPEED_SIGMA_M_S**2
        elif self._may_rest and quiet and self._now_ns >= self._rest_allowed_ns:
            if not self._is_stationary():
                return
            self.at_rest = True
            self._gated_fixes = 0
            self._published = None
            for axis, sigma in zip(axes, self._sigmas, strict=True):
                axis.rest(sigma)

    def _is_stationary(self) -> bool:
        """True if the fixes do not move; the estimated velocity cannot show it, because a tilt looks like an
        acceleration."""
        if self._rest_reference is None:
            return False
        then, then_ns = self._rest_reference
        span_s = (self._used_ns - then_ns) / 1e9
        if span_s < _REFERENCE_MIN_S:
            return False
        way_m = math.dist(then, self._found) - 2 * self._sigmas[0]
        if way_m <= _SLOW_M_S * span_s:
            return True
        self._rest_reference = None
        return False

    def _correct(self) -> None:
        if self._compass is not None:
            measured, share = self._compass
            self._compass = None
            if self._yaw is None:
                self._yaw = measured
            # the heading is predicted to the present instant, the compass was read at its stamp
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
        found, sigmas = self._located(fix)
        self._found, self._sigmas = found, sigmas
        span_s, self._used_ns = (self._fix_ns - self._used_ns) / 1e9, self._fix_ns
        if self._may_rest and (
            self._rest_reference is None or self._rest_reference[1] < self._standstill.since_ns
        ):
            self._rest_reference = found, self._fix_ns
        axes = self._axes
        if axes is None:
            noise = self._config.accel_sigma_m_s2
            x, y, z = (KalmanAxis(p, s, noise) for p, s in zip(found, sigmas, strict=True))
            self._axes = (x, y, z)
            return
        if self.at_rest:
            self._rest_at(axes, found, sigmas, span_s)
            return
        late_s = self.since_s(self._fix_ns)
        for axis, position, sigma in zip(axes, found, sigmas, strict=True):
            if late_s > _HELD_S:  # the speed since the fix is uncertain
                sigma = math.hypot(sigma, axis.v_sigma * late_s)  # noqa: PLW2901
            axis.update(position + axis.v * late_s, sigma)

    def _located(self, fix: GnssFix) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Converts a fix to map coordinates; returns position and standard deviations."""
        sigma_m = fix.sigma_m
        found = self._map.to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m)
        if fix.has_height:
            self._vertical_ns = self._fix_ns
            return found, (sigma_m, sigma_m, sigma_m * GNSS_HEIGHT_RATIO)
        vertical_m = SIGMA_MAX_M if self._flies else sigma_m * GNSS_HEIGHT_RATIO
        return (found[0], found[1], self._found[2]), (sigma_m, sigma_m, vertical_m)

    def _rest_at(
        self,
        axes: tuple[KalmanAxis, KalmanAxis, KalmanAxis],
        found: tuple[float, float, float],
        sigmas: tuple[float, float, float],
        span_s: float,
    ) -> None:
        """Averages a fix at rest; several consecutive fixes outside of the gate end the rest."""
        far = any(
            abs(position - axis.p) > _GATE * math.sqrt(axis.pp + sigma * sigma)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True)
        )
        self._gated_fixes = self._gated_fixes + 1 if far else 0
        if self._gated_fixes >= _GATE_FIXES:
            self.at_rest, self._rest_reference = False, None
            self._rest_allowed_ns = self._now_ns + round(_REST_BLOCKED_S * 1e9)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True):
                axis.restart(position, sigma)
        elif not far:
            share = self._correlated(span_s)
            for axis, position, sigma in zip(axes, found, sigmas, strict=True):
                axis.average(position, sigma * sigma * share)

    def _correct_height(self, axis: KalmanAxis, height_m: float) -> None:
        sigma, span_s = self._config.height_sigma_m, (self._now_ns - self._height_ns) / 1e9
        self._height_ns = self._vertical_ns = self._now_ns
        if self.at_rest:
            axis.average(height_m, sigma * sigma * self._correlated(span_s))
        else:
            axis.update(height_m, sigma)

    def _correlated(self, span_s: float) -> float:
        """Factor on the variance of a measurement with correlated errors (first-order Gauss-Markov)."""
        return max(1.0, 2 * self._config.gnss_correlation_s / max(span_s, 1e-3))

    def since_s(self, stamp_ns: int) -> float:
        """Time from a stamp to the instant of the last `predict`."""
        return min(max((self._now_ns - stamp_ns) / 1e9, 0.0), _PREDICTION_MAX_S)

    def pose(self, late_ns: int = 0) -> Pose | None:
        """The estimate at the instant of the last `predict`, or None if it is invalid.

        A delay of this step is not a silence of the sensors, because their drivers were delayed as well.
        """
        if self._axes is None or self._yaw is None:
            return None
        config, now_ns = self._config, self._now_ns - min(late_ns, _LATE_MAX_NS)
        if (
            now_ns - self._fix_ns > config.gnss_timeout_s * 1e9
            or (self._flies and now_ns - self._vertical_ns > config.gnss_timeout_s * 1e9)
            or now_ns - self._imu_ns > config.imu_timeout_s * 1e9
        ):
            return None
        x, y, z = self._axes
        if not self.at_rest:
            return Pose.planar(x.p, y.p, z.p, self._yaw, (x.v, y.v, z.v), self._w)
        stated = self._published
        if (
            stated is None
            or math.dist((x.p, y.p, z.p), (stated.x_m, stated.y_m, stated.z_m)) > _STEP_M
            or abs(math.remainder(self._yaw - self._published_yaw, math.tau)) > _STEP_RAD
        ):
            stated = self._published = Pose.planar(x.p, y.p, z.p, self._yaw)
            self._published_yaw = self._yaw
        return stated


class PoseEstimation:
    """Connects the estimator with the state of the vehicle, from which rest and landing are known."""

    def __init__(self, config: EstimatorConfig, origin: Origin, *, flies: bool, hovers: bool) -> None:
        self._estimator = Estimator(config, origin, flies=flies)
        self._hovers = hovers
        """True if the vehicle touches down without rolling."""
        self._vehicle: VehicleState | None = None
        self._by_hand = False
        self._setpoint = STOP

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """Takes a position fix."""
        self._estimator.on_gnss(fix, stamp_ns)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes rates, specific force and heading."""
        self._estimator.on_imu(imu, stamp_ns)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground."""
        self._estimator.on_height(height_m)

    def on_vehicle(self, state: VehicleState) -> None:
        """Takes the state of the vehicle with armed and landed."""
        self._vehicle = state

    def on_control(self, control: ControlState) -> None:
        """Takes the driver of the vehicle; a vehicle driven by hand may move at any time."""
        self._by_hand = control.mode is not DriveMode.AUTO

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """Takes the set-point in force; a set-point that moves the vehicle ends a rest."""
        self._setpoint = setpoint

    @property
    def resting(self) -> bool:
        """True if the vehicle is disarmed and on the ground."""
        return self._vehicle is not None and self._vehicle.resting

    def step(self, now_ns: int, late_ns: int = 0) -> Pose | None:
        """Computes the present pose, or None if it is invalid; `late_ns`: scheduling delay of this step."""
        vehicle, estimator = self._vehicle, self._estimator
        landed = vehicle is not None and vehicle.landed
        armed = vehicle is not None and vehicle.armed
        # an armed vehicle on the ground may start at any time when it is driven by hand
        estimator.on_driven(not landed or (armed and (self._by_hand or self._setpoint != STOP)))
        estimator.predict(now_ns)
        if landed and armed and self._hovers:
            estimator.on_landed()
        return estimator.pose(late_ns)
