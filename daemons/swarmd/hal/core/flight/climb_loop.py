"""Height and climb loop: commands a vertical acceleration for a climb rate."""

from typing import Final

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.model.hover_gains import HoverGains, HoverLimits

_AHEAD_M: Final = 0.3
"""Maximum distance of the commanded height from the vehicle's height."""
_LEARNS_M_S: Final = 1.5
"""Error of the climb rate above which the integral is frozen; errors of mass or thrust are smaller."""
_INTEGRAL_MAX_M_S2: Final = 3.0
"""Bound of the integral, which compensates a difference to the configured mass."""


class ClimbLoop:
    """PI controller of the climb rate, in cascade below a proportional controller of the height."""

    __slots__ = ("_height_m", "_integral")

    def __init__(self) -> None:
        self._height_m: float | None = None
        self._integral = 0.0

    def reset(self) -> None:
        """Clears the integral and the commanded height."""
        self._height_m = None
        self._integral = 0.0

    def resume(self) -> None:
        """Continues after a gap with the vehicle's present height as the commanded height."""
        self._height_m = None

    def acceleration_m_s2(
        self,
        gains: HoverGains,
        limits: HoverLimits,
        wanted_m_s: float,
        state: FlightState,
        dt_s: float,
    ) -> float:
        """Vertical acceleration that follows a climb rate and keeps the commanded height."""
        wanted_m_s = max(-limits.sink_max_m_s, min(limits.climb_max_m_s, wanted_m_s))
        height_m, climb_m_s = state.position_m[2], state.velocity_m_s[2]
        held = height_m if self._height_m is None else self._height_m + wanted_m_s * dt_s
        # near the vehicle, so that a held vehicle does not shoot up when it is released
        held = self._height_m = max(height_m - _AHEAD_M, min(height_m + _AHEAD_M, held))
        error = wanted_m_s + gains.height_kp_1_s * (held - height_m) - climb_m_s
        # with a larger error the thrust is at its limit, and the integral would wind up
        learns = abs(error) < _LEARNS_M_S
        integral = self._integral + (gains.climb_ki_1_s2 * error * dt_s if learns else 0.0)
        self._integral = max(-_INTEGRAL_MAX_M_S2, min(_INTEGRAL_MAX_M_S2, integral))
        return gains.climb_kp_1_s * error + self._integral
