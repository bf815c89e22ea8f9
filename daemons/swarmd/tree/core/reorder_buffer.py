"""Reorder buffer of one lane of notifications: delivers them in order, each once."""

from typing import Final

from swarmware.errors import WireError
from swarmware.types.tree import TreeNotify

REORDER_WINDOW: Final = 512
"""Serials from the oldest unacknowledged one: ten seconds of one every 20 ms."""


class ReorderBuffer:
    """Holds notifications that arrive early; drops duplicates."""

    __slots__ = ("_expected", "_waiting")

    def __init__(self) -> None:
        self._expected: int | None = None
        self._waiting: dict[int, TreeNotify] = {}

    def take(self, notify: TreeNotify) -> list[TreeNotify]:
        """Add a notification; returns those in order. Raises: WireError for a serial out of the window."""
        serial = notify.serial
        first = notify.first or serial
        if not first <= serial < first + REORDER_WINDOW:
            raise WireError(f"notification {serial} of {notify.platform}: its window begins with {first}")
        ready: list[TreeNotify] = []
        if self._expected is None:
            self._expected = first
        elif first > self._expected:
            # the owner does not retransmit older ones: what is missing never arrives
            ready = [self._waiting.pop(held) for held in sorted(self._waiting) if held < first]
            self._expected = first
        if serial >= self._expected:
            self._waiting[serial] = notify
        while (following := self._waiting.pop(self._expected, None)) is not None:
            ready.append(following)
            self._expected += 1
        return ready
