"""The contract of a sans-io core, and what its driver needs of the world."""

from collections.abc import Callable
from typing import Final, Protocol, TypeVar

AT_ONCE: Final = -(1 << 63)
"""A deadline that has always passed."""

Action = TypeVar("Action")


class Core(Protocol[Action]):
    """Decides, and does nothing: time is an argument, actions are the result.

    What happens is a method `on_<event>(…, now_ns) -> list[Action]`; a core has as many as it needs.
    """

    def on_timer(self, now_ns: int) -> list[Action]:
        """What is due at this instant. Called at the deadline or after it, never before."""
        ...

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called; in the past: in the next turn; None: not before another event."""
        ...


class HardwareClock(Protocol):
    """The clock in whose time a core thinks."""

    def now_ns(self) -> int:
        """The present instant on the hardware clock."""
        ...

    def to_mono_ns(self, stamp_ns: int) -> int:
        """The instant of CLOCK_MONOTONIC at which this clock shows the stamp."""
        ...


class Alarm(Protocol):
    """A call that has been asked for."""

    def cancel(self) -> None:
        """It is not made."""
        ...


class EventLoop(Protocol):
    """What a driver needs of an event loop: asyncio's, uvloop's, or the one of virtual time."""

    def call_later(self, delay: float, callback: Callable[[], None], /) -> Alarm:
        """Calls back after so many seconds; uvloop rounds them to milliseconds."""
        ...
