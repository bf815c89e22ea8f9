"""Order of the notifications of another tree: of one start, each lane in order, each notification once."""

from typing import Final

from swarmware.errors import WireError
from swarmware.types.tree_exchange import TreeNotify

REORDER_WINDOW: Final = 512
"""Serials from the oldest unacknowledged one: ten seconds of one every 20 ms."""
FORMER_EPOCHS: Final = 8
"""Former epochs of another tree whose late notifications are recognised."""


class ReorderBuffer:
    """Holds notifications of one lane that arrive early; drops duplicates."""

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
        # a smaller serial is a duplicate, whose acknowledgement was lost
        if serial >= self._expected:
            self._waiting[serial] = notify
        while (following := self._waiting.pop(self._expected, None)) is not None:
            ready.append(following)
            self._expected += 1
        return ready


class NotificationReceiver:
    """Reorder buffers of one other tree; a restart of it begins with new ones."""

    __slots__ = ("_buffers", "_epoch", "_former")

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._buffers: dict[int, ReorderBuffer] = {}
        self._former: tuple[int, ...] = ()

    def is_former(self, epoch: int) -> bool:
        """Whether the tree has restarted since this epoch."""
        return epoch in self._former

    def take(self, notify: TreeNotify) -> list[TreeNotify]:
        """Add a notification; returns those in order. Raises: WireError for a serial out of the window."""
        if notify.epoch != self._epoch:
            # a restarted tree counts again from its first serial
            self._epoch, self._buffers = notify.epoch, {}
        return self._buffers.setdefault(notify.lane, ReorderBuffer()).take(notify)

    def on_epoch(self, epoch: int, before: int | None) -> None:
        """The tree has this epoch, and had another one before: what comes late of that is refused."""
        former = [one for one in self._former if one != epoch]
        for one in (before, self._epoch):
            if one is not None and one not in {epoch, *former}:
                former.append(one)
        self._former = tuple(former[-FORMER_EPOCHS:])
