"""Altitude hold with a PID controller."""

from swarmd.navigator.config import AltitudeConfig


class AltitudeHold:
    """PID controller from height to climb rate; the derivative of the measurement avoids derivative kick."""

    __slots__ = ("_gains", "_integral_m_s")

    def __init__(self, gains: AltitudeConfig) -> None:
        self._gains = gains
        self._integral_m_s = 0.0

    def set_gains(self, gains: AltitudeConfig) -> None:
        """Replaces the gains, also in flight (S2.46)."""
        self._gains = gains

    def reset(self) -> None:
        """Clears the integral, which would wind up on the ground."""
        self._integral_m_s = 0.0

    def climb_m_s(
        self,
        wanted_m: float,
        height_m: float,
        climb_m_s: float,
        max_m_s: float,
        min_m_s: float,
        dt_s: float,
    ) -> float:
        """Commanded climb rate within its limits; the lower limit is negative."""
        gains = self._gains
        error_m = wanted_m - height_m
        unlimited = gains.kp_1_s * error_m + self._integral_m_s - gains.kd * climb_m_s
        answer = min(max(unlimited, min_m_s), max_m_s)
        # anti-windup: the integral grows only while the output is not saturated
        if answer == unlimited or (unlimited - answer) * error_m < 0:
            self._integral_m_s += gains.ki_1_s2 * error_m * dt_s
        return answer
