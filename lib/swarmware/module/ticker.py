"""Periodic ticks at multiples of a period on the node's clock; missed ones are counted and skipped."""

from typing import Final

from swarmware.errors import InvalidInput
from swarmware.model.clock import Clock
from swarmware.runtime.instant import until

MIN_PERIOD_S: Final = 1e-6
MAX_PERIOD_S: Final = 1e9
"""Longest period, so that periods in nanoseconds fit 64 bits, as for the rate of a resource."""


class Lateness:
    """Maximum lateness of the tickers of an event loop."""

    __slots__ = ("_worst_ns",)

    def __init__(self) -> None:
        self._worst_ns = 0

    def note(self, late_ns: int) -> None:
        """Record the lateness of one tick."""
        self._worst_ns = max(self._worst_ns, late_ns)

    def take_s(self) -> float:
        """The maximum since the last call, in seconds."""
        worst_ns, self._worst_ns = self._worst_ns, 0
        return worst_ns / 1e9


class Ticker:
    """`async for tick in m.every(0.1)`: number of each tick; a tick late by more than a period is skipped.

    All tickers of a node have the same origin, so the periodic work of a process is done together: it wakes
    less often, with warm caches. `stage`, `phase_ns`: order of work at the same instant, see `Module.every`.
    """

    def __init__(
        self,
        clock: Clock,
        period_s: float,
        lateness: "Lateness | None" = None,
        *,
        stage: int = 0,
        phase_ns: int = 0,
    ) -> None:
        if not MIN_PERIOD_S <= period_s <= MAX_PERIOD_S:
            raise InvalidInput(
                f"period of {period_s} s: expected {MIN_PERIOD_S:g} to {MAX_PERIOD_S:g}, more than 0"
            )
        self._clock = clock
        self._lateness = lateness
        self.period_s = period_s
        self._period_ns = round(period_s * 1e9)
        self._stage = stage
        self._phase_ns = phase_ns
        now_ns = clock.now_ns()
        # the last multiple before now: all tickers of a period share their instants
        self._start_ns = now_ns - (now_ns - phase_ns) % self._period_ns
        self._count = 0
        self.missed = 0
        """Ticks that were skipped because the work of the previous one took too long."""
        self.late_ns = 0
        """Lateness of the newest tick."""

    def __aiter__(self) -> "Ticker":
        return self

    async def __anext__(self) -> int:
        """Wait for the next tick; its number, the skipped ones counted."""
        self._count += 1
        late_ns = self._clock.now_ns() - (self._start_ns + self._count * self._period_ns)
        if late_ns > self._period_ns:
            # skipped, not made up: a burst of late ticks would only delay others
            skipped = late_ns // self._period_ns
            self._count += skipped
            self.missed += skipped
        due_ns = self._start_ns + self._count * self._period_ns
        await until(self._clock, due_ns, self._stage)
        self.late_ns = self._clock.now_ns() - due_ns
        if self._lateness is not None:
            self._lateness.note(self.late_ns)
        return self._count

    def retime(self, period_s: float) -> None:
        """Tick with another period from now on."""
        if period_s != self.period_s:
            self.__init__(  # type: ignore[misc]
                self._clock, period_s, self._lateness, stage=self._stage, phase_ns=self._phase_ns
            )
