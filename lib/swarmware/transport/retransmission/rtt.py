"""Round-trip time, the retransmission time-out that follows from it, and the queue that it shows.

Ten lines of RFC 6298: there is no library for it, and libzmq gives no round-trip time of its connections.
"""

from collections import deque

from swarmware.transport.retransmission.policy import RetransmissionPolicy


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
    def worst_ns(self) -> int:
        """The larger of the smoothed and the newest round trip."""
        return max(round(self._smoothed_ns), self._latest_ns)

    def timeout_ns(self, policy: RetransmissionPolicy) -> int:
        """Time until the first retransmission."""
        if self._smoothed_ns == 0.0:
            return policy.initial_ns
        timeout_ns = round(self._smoothed_ns + max(4 * self._variation_ns, policy.granularity_ns))
        return max(policy.min_ns, min(timeout_ns, policy.max_ns))


class QueueDelay:
    """Delay of a queue: the smallest of the newest delays above the minimum of the last seconds.

    Not the mean of the newest ones, because delays scatter. The minimum is taken over the present interval
    and the former one, so that it never rests on a few samples just after a change.
    """

    __slots__ = ("_former_ns", "_interval_ns", "_minimum_ns", "_newest_ns", "_since_ns")

    def __init__(self, interval_ns: int, newest: int, now_ns: int, minimum_ns: int | None = None) -> None:
        """`newest`: number of delays that show the present queue. `minimum_ns`: first guess, if known."""
        self._interval_ns = interval_ns
        self._newest_ns: deque[int] = deque(maxlen=newest)
        self._since_ns = now_ns
        self._minimum_ns = minimum_ns
        self._former_ns: int | None = None

    def add(self, delay_ns: int, now_ns: int) -> None:
        """Add one measured delay."""
        if now_ns - self._since_ns >= self._interval_ns:
            self._former_ns, self._minimum_ns = self._minimum_ns, None
            self._since_ns = now_ns
        self._minimum_ns = delay_ns if self._minimum_ns is None else min(self._minimum_ns, delay_ns)
        self._newest_ns.append(delay_ns)

    @property
    def minimum_ns(self) -> int | None:
        """Minimum over the last seconds, or None before the first delay."""
        known = [one for one in (self._minimum_ns, self._former_ns) if one is not None]
        return min(known) if known else None

    @property
    def queueing_ns(self) -> int:
        """Delay of the queue, or 0 before the first delay."""
        return max(0, min(self._newest_ns) - (self.minimum_ns or 0)) if self._newest_ns else 0

    def restart(self) -> None:
        """No queue causes the newest delays: they are the minimum from now on."""
        self._minimum_ns, self._former_ns = min(self._newest_ns), None
