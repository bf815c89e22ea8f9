"""The contract of a sans-io core, the interfaces that its driver uses, the grid of shared instants."""

from collections.abc import Callable
from typing import Final, Protocol, TypeVar

AT_ONCE: Final = -(1 << 63)
"""A deadline before every instant: due at once."""

Action = TypeVar("Action")


class Core(Protocol[Action]):
    """A pure core: time is an argument, and actions are the result.

    Each event is a method `on_<event>(…, now_ns) -> list[Action]`.
    """

    def on_timer(self, now_ns: int) -> list[Action]:
        """Return the actions that are due. Called at the deadline or after it, never before."""
        ...

    def deadline_ns(self) -> int | None:
        """Instant at which `on_timer` must be called (at once if in the past), or None without a deadline."""
        ...


class HardwareClock(Protocol):
    """The clock whose time a core uses."""

    def now_ns(self) -> int:
        """The present instant on the hardware clock."""
        ...

    def to_mono_ns(self, stamp_ns: int) -> int:
        """The instant of CLOCK_MONOTONIC at which this clock shows the stamp."""
        ...


class Alarm(Protocol):
    """A scheduled call that can be cancelled."""

    def cancel(self) -> None:
        """Cancel the scheduled call."""
        ...


class EventLoop(Protocol):
    """Interface of an event loop for a driver: asyncio's, uvloop's, or the virtual-time loop."""

    def call_later(self, delay: float, callback: Callable[[], None], /) -> Alarm:
        """Schedule a call after a delay in seconds; uvloop rounds it to milliseconds."""
        ...


def next_multiple_ns(now_ns: int, period_ns: int, phase_ns: int = 0) -> int:
    """The first multiple of a period after now, each `phase_ns` later."""
    return now_ns + period_ns - (now_ns - phase_ns) % period_ns
