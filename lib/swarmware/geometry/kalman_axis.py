"""Kalman filter with two states for one axis: position and velocity.

Without a library: libraries need numpy, which the node of an air vehicle does not have, and are slower for
matrices of this size.
"""

import math
from typing import Final

FIRST_SPEED_SIGMA_M_S: Final = 0.5
"""Standard deviation of the velocity of a vehicle of which nothing is known."""
_REST_SIGMA_M_S: Final = 0.05
"""Standard deviation of the velocity after a rest that a set-point ends."""
_VARIANCE_MIN_M2: Final = 1e-6
"""Smallest variance of a measurement: no measurement is exact, and none makes the filter divide by zero."""
SIGMA_MAX_M: Final = 1000.0
"""Standard deviation of a position of which nothing is known."""


class KalmanAxis:
    """Kalman filter of one axis: state position and velocity, input the measured acceleration.

    Units: metres, seconds. The error covariance is symmetric: pp, pv, vv. A measurement that is not a finite
    number, or whose standard deviation is not, is ignored.
    """

    __slots__ = ("_noise", "p", "pp", "pv", "v", "vv")

    def __init__(self, position: float, sigma: float, accel_sigma: float) -> None:
        self.p = position
        self.v = 0.0
        self.pp = _variance(sigma)
        self.pv = 0.0
        self.vv = FIRST_SPEED_SIGMA_M_S**2
        self._noise = accel_sigma * accel_sigma

    @property
    def v_sigma(self) -> float:
        """Standard deviation of the velocity."""
        return math.sqrt(max(self.vv, 0.0))

    def predict(self, accel: float, dt_s: float, accel_sigma: float | None = None) -> None:
        """Predicts the state and its covariance by dt at constant acceleration.

        `accel_sigma`: standard deviation of this acceleration, if it differs from measured accelerations.
        """
        half = dt_s * dt_s / 2
        self.p += self.v * dt_s + accel * half
        self.v += accel * dt_s
        q = self._noise if accel_sigma is None else accel_sigma * accel_sigma
        self.pp += dt_s * (2 * self.pv + dt_s * self.vv) + q * half * half
        self.pv += dt_s * self.vv + q * half * dt_s
        self.vv += q * dt_s * dt_s

    def widen(self, accel_sigma: float, dt_s: float) -> None:
        """Adds the uncertainty of a constant acceleration that acted for dt and was not measured."""
        position, velocity = accel_sigma * dt_s * dt_s / 2, accel_sigma * dt_s
        self.pp += position * position
        self.pv += position * velocity
        self.vv += velocity * velocity

    def rest(self, sigma: float) -> None:
        """Begins a rest: zero velocity, and a position no better than one fix."""
        self.v = self.pv = 0.0
        self.vv = _REST_SIGMA_M_S**2
        self.pp = max(self.pp, sigma * sigma)

    def average(self, measured: float, variance: float) -> None:
        """Corrects the position of a vehicle at rest by a measured one."""
        if not math.isfinite(measured + variance):
            return
        share = self.pp / (self.pp + max(variance, _VARIANCE_MIN_M2))
        self.p += share * (measured - self.p)
        self.pp *= 1 - share

    def restart(self, measured: float, sigma: float) -> None:
        """Resets the position to a measured one, and the velocity to unknown."""
        self.p, self.pp = measured, _variance(sigma)
        self.v, self.pv, self.vv = 0.0, 0.0, FIRST_SPEED_SIGMA_M_S**2

    def update(self, measured: float, sigma: float) -> None:
        """Corrects position and velocity by a measured position."""
        if not math.isfinite(measured + sigma):
            return
        innovation_variance = self.pp + _variance(sigma)
        kp, kv = self.pp / innovation_variance, self.pv / innovation_variance
        innovation = measured - self.p
        self.p += kp * innovation
        self.v += kv * innovation
        self.vv -= kv * self.pv
        self.pv *= 1 - kp
        self.pp *= 1 - kp


def _variance(sigma: float) -> float:
    """Variance of a measurement; a standard deviation that is not finite means that nothing is known."""
    known_m = abs(sigma) if math.isfinite(sigma) else SIGMA_MAX_M
    return max(known_m * known_m, _VARIANCE_MIN_M2)
