"""An event loop in virtual time that counts its wakes; its timers count milliseconds, as uvloop's do."""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import Any, TypeVarTuple

from swarmware.model.clock import Clock

_Ts = TypeVarTuple("_Ts")

MS_NS = 1_000_000


class _Selector(selectors.DefaultSelector):
    def __init__(self) -> None:
        super().__init__()
        self.now_ns = 0
        self.wakes: list[int] = []

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout > 0:
            self.now_ns += max(1, round(timeout * 1000)) * MS_NS
            self.wakes.append(self.now_ns)
        return super().select(0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """Time passes while everybody waits, and where a test says so."""

    def __init__(self) -> None:
        self.virtual = _Selector()
        super().__init__(self.virtual)

    def time(self) -> float:
        return self.virtual.now_ns // MS_NS / 1000

    def call_later(
        self, delay: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        return super().call_later(round(delay * 1000) / 1000, callback, *args, context=context)


class VirtualClock(Clock):
    """A node's clock in the time of a loop; a look at it takes no time."""

    __slots__ = ("_selector",)

    def __init__(self, loop: VirtualLoop, offset_s: float = 0.0, drift_ppm: float = 0.0) -> None:
        super().__init__(offset_s, drift_ppm)
        self._selector = loop.virtual

    def now_ns(self) -> int:
        return self.from_mono_ns(self._selector.now_ns)

    def spend(self, span_ns: int) -> None:
        """Somebody computes for so long."""
        self._selector.now_ns += span_ns


def run(main: Callable[[VirtualLoop], Coroutine[Any, Any, None]]) -> VirtualLoop:
    """Runs it to its end; the loop, with the instants of its wakes."""
    loop = VirtualLoop()
    try:
        loop.run_until_complete(main(loop))
    finally:
        loop.close()
    return loop
