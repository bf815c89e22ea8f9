"""Round-trip time to one hardware unit, and the retransmission timeout that follows from it.

Ten lines of RFC 6298: there is no library for it, and libzmq gives no round-trip time of its connections.
"""

import msgspec


class RetransmitLimits(msgspec.Struct, frozen=True):
    """Limits of the time between two transmissions."""

    initial_ns: int
    """Timeout before the first measured round trip."""
    min_ns: int
    max_ns: int


class RttEstimator:
    """Smoothed round-trip time and its variation.

    Source: RFC 6298, section 2.
    """

    __slots__ = ("_latest_ns", "_smoothed_ns", "_variation_ns")

    def __init__(self) -> None:
        self._latest_ns = 0
        self._smoothed_ns = 0.0
        self._variation_ns = 0.0

    def add(self, sample_ns: int) -> None:
        """Add one measured round trip."""
        self._latest_ns = sample_ns
        if self._smoothed_ns == 0.0:
            self._smoothed_ns = float(sample_ns)
            self._variation_ns = sample_ns / 2
            return
        self._variation_ns += 0.25 * (abs(self._smoothed_ns - sample_ns) - self._variation_ns)
        self._smoothed_ns += 0.125 * (sample_ns - self._smoothed_ns)

    @property
    def smoothed_ns(self) -> int:
        """Smoothed round trip, or 0 before the first measurement."""
        return round(self._smoothed_ns)

    @property
    def variation_ns(self) -> int:
        """Mean deviation of the round trip."""
        return round(self._variation_ns)

    @property
    def worst_ns(self) -> int:
        """The larger of the smoothed and the newest round trip."""
        return max(round(self._smoothed_ns), self._latest_ns)

    def timeout_ns(self, limits: RetransmitLimits) -> int:
        """Time until the first retransmission."""
        if self._smoothed_ns == 0.0:
            return limits.initial_ns
        timeout_ns = round(self._smoothed_ns + 4 * self._variation_ns)
        return max(limits.min_ns, min(timeout_ns, limits.max_ns))
