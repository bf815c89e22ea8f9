"""A period: ticks at absolute instants, misses counted and never made up for."""

import asyncio

from swarmware.clock import Clock


class Ticker:
    """`async for tick in m.every(0.1)`: the count of ticks; late by more than a period skips."""

    def __init__(self, clock: Clock, period_s: float) -> None:
        if period_s <= 0:
            raise ValueError(f"period of {period_s} s: expected more than 0")
        self._clock = clock
        self.period_s = period_s
        self._period_ns = round(period_s * 1e9)
        self._start_ns = clock.now_ns()
        self._count = 0
        self.missed = 0
        """Ticks that fell out because the one before took too long."""

    def __aiter__(self) -> "Ticker":
        return self

    async def __anext__(self) -> int:
        """Wait for the next tick; its number, the skipped ones counted."""
        self._count += 1
        late_ns = self._clock.now_ns() - (self._start_ns + self._count * self._period_ns)
        if late_ns > self._period_ns:
            skipped = late_ns // self._period_ns
            self._count += skipped
            self.missed += skipped
            late_ns -= skipped * self._period_ns
        await asyncio.sleep(max(0.0, -late_ns / 1e9))
        return self._count

    def retime(self, period_s: float) -> None:
        """Tick with another period from now on."""
        if period_s != self.period_s:
            self.__init__(self._clock, period_s)  # type: ignore[misc]
