"""The one rule of a back-off, and with it the restarts of a process or service that ended."""

from __future__ import annotations

from swarmware.footprint.annotations import Final, Sequence, TypeVar

Pause = TypeVar("Pause", int, float)
PAUSES_S: Final = (0.0, 0.5, 1.0, 2.0, 5.0)
"""Pauses before the first, second, … consecutive restart; the last one from then on."""
SETTLED_S: Final = 1.0
"""Time from ready to the end after which the end is not a failed start: the restart has no pause.

A start takes some 0.1 s, so a process that always fails at this age takes a tenth of a processor.
"""
LIMIT: Final = 20
"""Consecutive restarts after which the process is given up."""


def pause_after(failures: int, pauses: Sequence[Pause]) -> Pause:
    """Pause before the next attempt; `failures`: consecutive failures, at least one.

    Shapes: `pauses`: after the first, second, … failure; the last one from then on.
    """
    return pauses[min(failures, len(pauses)) - 1]


class RestartPolicy:
    """Back-off and limit of the restarts of one process or service; limit 0: none."""

    def __init__(
        self, *, pauses_s: Sequence[float] = PAUSES_S, settled_s: float = SETTLED_S, limit: int = LIMIT
    ) -> None:
        self._pauses_s = pauses_s
        self._settled_ns = round(settled_s * 1e9)
        self._limit = limit
        self._ready_ns: int | None = None
        self.consecutive = 0
        """Consecutive ends, each of a process that was not ready, or not yet for `settled_s`."""
        self.restarts = 0
        """Restarts since the start."""

    def on_ready(self, now_ns: int) -> None:
        """Record that the present process is ready."""
        self._ready_ns = now_ns

    def on_end(self, now_ns: int, *, killed: bool = False) -> float | None:
        """Pause before the next start, in seconds, or None after the last attempt.

        `killed`: ended by SIGKILL from outside, which is not a failure of a process that was ready.
        """
        ready_ns, self._ready_ns = self._ready_ns, None
        settled = ready_ns is not None and (killed or now_ns - ready_ns >= self._settled_ns)
        # 1, not 0: this end is the first of a possible row
        self.consecutive = 1 if settled else self.consecutive + 1
        if self._limit and self.consecutive > self._limit:
            return None
        self.restarts += 1
        return pause_after(self.consecutive, self._pauses_s)

    def reset(self) -> None:
        """Reset the count of consecutive ends, because an operator restarts it."""
        self.consecutive = 0
