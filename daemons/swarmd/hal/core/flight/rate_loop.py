"""Rate loop: commands moments for commanded body rates."""

from typing import Final

from swarmware.geometry.attitude import Vector
from swarmware.model.hover_gains import HoverGains

_INTEGRAL_MAX_RAD_S2: Final = 4.0
"""Bound of the integral, which compensates uneven rotors and errors of the configured centre of mass."""


class RateLoop:
    """PI controller of the body rates, with compensation of the gyroscopic moment."""

    __slots__ = ("_inertia", "_integral")

    def __init__(self, inertia_kg_m2: Vector) -> None:
        self._inertia = inertia_kg_m2
        self._integral = [0.0, 0.0, 0.0]

    def reset(self) -> None:
        """Clears the integral, which would wind up on the ground."""
        self._integral = [0.0, 0.0, 0.0]

    def moment_n_m(
        self, gains: HoverGains, wanted: Vector, rates: Vector, dt_s: float, *, learns: bool
    ) -> Vector:
        """Moments about the body axes; the integral follows the error only if `learns` is set."""
        tilt, yaw = (gains.rate_kp_1_s, gains.rate_ki_1_s2), (gains.yaw_rate_kp_1_s, gains.yaw_rate_ki_1_s2)
        integral, (ix, iy, iz), (p, q, r) = self._integral, self._inertia, rates
        accelerations = []
        # yaw is slower, since rotors produce little moment about this axis
        for axis, (kp, ki) in enumerate((tilt, tilt, yaw)):
            error = wanted[axis] - rates[axis]
            if learns:
                held = integral[axis] + ki * error * dt_s
                integral[axis] = max(-_INTEGRAL_MAX_RAD_S2, min(_INTEGRAL_MAX_RAD_S2, held))
            accelerations.append(kp * error + integral[axis])
        # Euler's equations: the last terms are the gyroscopic moment of the turning body
        a, b, c = accelerations
        return a * ix + (iz - iy) * q * r, b * iy + (ix - iz) * r * p, c * iz + (iy - ix) * p * q
