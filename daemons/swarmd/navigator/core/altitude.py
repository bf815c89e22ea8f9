"""Altitude hold."""

from swarmd.navigator.config import Altitude


class AltitudeHold:
    """PID from height to climb rate; the derivative acts on the measured climb: no kick by a new height."""

    __slots__ = ("_gains", "_sum_m_s")

    def __init__(self, gains: Altitude) -> None:
        self._gains = gains
        self._sum_m_s = 0.0

    def set_gains(self, gains: Altitude) -> None:
        """New gains, in flight (S2.46)."""
        self._gains = gains

    def reset(self) -> None:
        """Forget the integral: on the ground it would only grow."""
        self._sum_m_s = 0.0

    def climb_m_s(
        self,
        wanted_m: float,
        height_m: float,
        climb_m_s: float,
        most_m_s: float,
        least_m_s: float,
        dt_s: float,
    ) -> float:
        """Climb rate to ask for, between two limits (the lower one is negative)."""
        gains = self._gains
        wrong = wanted_m - height_m
        raw = gains.kp_1_s * wrong + self._sum_m_s - gains.kd * climb_m_s
        answer = min(max(raw, least_m_s), most_m_s)
        # anti-windup: the integral only grows while the limits leave it something to do
        if answer == raw or (raw - answer) * wrong < 0:
            self._sum_m_s += gains.ki_1_s2 * wrong * dt_s
        return answer
