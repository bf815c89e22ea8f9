"""How much the connections to a neighbour may hold in the kernel: as little as the link permits.

TCP fills whatever buffer it gets, in the kernel and before the link. So a connection has a small one, which
grows where the buffer, not the link, holds frames back.
"""

from typing import Final

import msgspec

from swarmd.broker.core.swarm.links.link import ConnectionDelay

SIZE_MIN: Final = 2304
"""First send buffer of a connection, the least that Linux knows: at most 9 kB are on the way then, which a
link that falls to 0.5 Mbit/s has carried after 0.15 s (`tests/integration/broker/falling.py`)."""
SIZE_MAX: Final = 32 * 1024
"""Limit on short ways; Linux doubles it."""
RATE_MAX_BYTES_S: Final = 8_000_000
"""Limit on long ways: this rate times the round trip. Linux doubles it, and half of that is its own."""
GROWTH: Final = 1.5
FREE_NS: Final = 10_000_000
"""Round trip above its minimum up to which the buffer, not the link, holds back frames that wait."""
SETTLED: Final = 2
"""Round trips after which a changed buffer shows in their mean."""
TRIAL_NS: Final = 200_000_000
"""Least time of a trial: acknowledgements may be 40 ms late."""
TRIAL_AGAIN_NS: Final = 5_000_000_000
SHARE: Final = 1 / 4
"""Part of the delay by which it rises at least in a trial, if it is a queue: the buffer is half as large
again."""


class _Trial(msgspec.Struct, frozen=True):
    """The buffer has grown to see whether a delay is its own queue."""

    excess_ns: int
    """The delay before it grew."""
    due_ns: int
    former_size: int


class SendBuffer:
    """The size of the send buffer of the connections to one neighbour."""

    def __init__(self) -> None:
        self.size = SIZE_MIN
        self._longer_ns = 0
        """Part of the round trip above the kernel's minimum by which the way has become longer."""
        self._next_ns: int | None = None
        """Earliest instant at which it grows again, or begins a trial, or None for at once."""
        self._trial: _Trial | None = None

    def queue_ns(self, delay: ConnectionDelay) -> int:
        """The queue before the link: the part of the round trip that the path does not explain."""
        self._longer_ns = min(self._longer_ns, delay.excess_ns)
        return delay.excess_ns - self._longer_ns

    def on_waiting(self, delay: ConnectionDelay, now_ns: int) -> int | None:
        """Takes that frames wait behind a short queue; returns the new size, or None to keep it."""
        if self._trial is not None:
            return self._end_trial(self._trial, delay, now_ns)
        if self._next_ns is not None and now_ns < self._next_ns:
            return None
        settled_ns = SETTLED * delay.smoothed_ns
        # a longer path and a queue look alike; only a trial distinguishes them
        if self.queue_ns(delay) > FREE_NS:
            due_ns = now_ns + max(TRIAL_NS, settled_ns)
            self._trial = _Trial(delay.excess_ns, due_ns, self.size)
        else:
            self._next_ns = now_ns + settled_ns
        return self._resize(round(GROWTH * self.size), delay)

    def _end_trial(self, trial: _Trial, delay: ConnectionDelay, now_ns: int) -> int | None:
        if now_ns < trial.due_ns:
            return None
        self._trial = None
        is_present = now_ns < trial.due_ns + TRIAL_NS  # otherwise no frames waited meanwhile
        if is_present and delay.excess_ns - trial.excess_ns < SHARE * (trial.excess_ns - self._longer_ns):
            self._longer_ns = min(trial.excess_ns, delay.excess_ns)
            self._next_ns = now_ns
            return None
        self._next_ns = now_ns + TRIAL_AGAIN_NS
        return self._resize(trial.former_size, delay)

    def _resize(self, size: int, delay: ConnectionDelay) -> int:
        way_ns = delay.min_ns + self._longer_ns
        self.size = min(size, max(SIZE_MAX, RATE_MAX_BYTES_S * way_ns // 1_000_000_000))
        return self.size

    def shrink(self) -> int:
        """There is a queue: the least size."""
        self._trial, self._next_ns = None, None
        self.size = SIZE_MIN
        return self.size
