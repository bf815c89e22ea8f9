"""The delay of a core by its own event loop: time in which it did not listen, so others were not silent."""

from typing import Final

from swarmware.runtime.core import AT_ONCE

LATE_NS: Final = 100_000_000
"""A shorter delay does not count: two periods of the fastest tasks."""
MEMORY_NS: Final = 5_000_000_000
"""Time for which a delay is remembered: values that it delayed are judged in the turns after it, too."""
_LONG_AGO: Final = -(1 << 62)


class LoopDelay:
    """Delays of a core by its event loop, measured at its deadlines.

    Where the processor is short, a turn of the event loop takes long, and a core finds values that wait to be
    taken. It extends its time-outs by that pause, before it declares others dead.

    Source: Dadgar et al., "Lifeguard: local health awareness for more accurate failure detection", 2018.
    """

    __slots__ = ("_counted_ns", "_since_ns", "_worst_ns", "_worst_of_former_ns")

    def __init__(self) -> None:
        self._counted_ns = _LONG_AGO
        """Until here delays are counted: several calls of one late turn count it once."""
        self._worst_ns = self._worst_of_former_ns = 0
        """Longest delay since `_since_ns`, and in the time before it."""
        self._since_ns = _LONG_AGO

    def on_turn(self, due_ns: int | None, now_ns: int) -> int:
        """The core is called, and was due at an instant; returns for how long it did not listen since then,
        0 up to a tenth of a second.

        None: it had no deadline.
        """
        if due_ns is None or due_ns <= AT_ONCE or now_ns - due_ns <= LATE_NS:
            return 0
        late_ns = now_ns - max(due_ns, self._counted_ns)
        if late_ns <= LATE_NS:
            return 0
        self._counted_ns = now_ns
        self._forget(now_ns)
        self._worst_ns = max(self._worst_ns, late_ns)
        return late_ns

    def recent_ns(self, now_ns: int) -> int:
        """Longest delay of the last seconds."""
        self._forget(now_ns)
        return max(self._worst_ns, self._worst_of_former_ns)

    def _forget(self, now_ns: int) -> None:
        elapsed_ns = now_ns - self._since_ns
        if elapsed_ns < MEMORY_NS:
            return
        self._worst_of_former_ns = self._worst_ns if elapsed_ns < 2 * MEMORY_NS else 0
        self._worst_ns, self._since_ns = 0, now_ns
