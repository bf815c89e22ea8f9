"""Notifications of one lane to one subscriber: a window of them, each retransmitted until acknowledged."""

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

import msgspec

from swarmd.tree.core.notification.board_history import BoardHistory
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.reorder_buffer import REORDER_WINDOW
from swarmware.transport.retransmission.flight import Flight, Sent
from swarmware.transport.retransmission.policy import RetransmissionPolicy
from swarmware.types.tree_exchange import TreeItem, TreeNotify

LANE: Final = RetransmissionPolicy(
    window_first=64 * 1024,  # half a second at 1 Mbit/s
    window_min=8 * 1024,
    window_max=256 * 1024,
    window_growth=1 / 4,
    count_max=64,  # less than the inbox of the other tree holds
    ignores_single_losses=True,
)
"""The window counts bytes of values. A failure halves it, so that a slow link gets less a second time."""
SPAN: Final = REORDER_WINDOW
"""Maximum span of serials: the receiver holds all later ones back for the oldest."""
SPAN_BYTES: Final = 1024 * 1024
COALESCE_NS: Final = 20_000_000
"""While one is unacknowledged, values within this time are sent together in the next."""


class LaneNumber(IntEnum):
    """Lanes of a subscriber, each with its own priority on links: none waits for losses of another."""

    UPDATES = 0
    """Events, settings, changes of the structure."""
    STREAMS = 1
    BOARDS = 2
    BACKLOG = 3
    """Former values of boards: below everything else."""


Parts = list[tuple[Feed | BoardHistory, list[TreeItem]]]


class UnacknowledgedNotification(Sent):
    """A notification that is sent and not acknowledged."""

    notify: TreeNotify
    parts: Parts
    offset: int
    """Bytes that the lane had sent before."""


class NotificationLane(Flight[int, UnacknowledgedNotification]):
    """Sends notifications with consecutive serials; the receiver restores their order."""

    def __init__(self, number: LaneNumber, serial: int = 0) -> None:
        """`serial`: of the notification before the first one."""
        super().__init__(LANE)
        self.number = number
        self._sent_bytes = 0
        self.serial = serial

    def has_room(self, size: int = 1) -> bool:
        """Whether the window has room for a notification."""
        first = self.get(self.first)
        return first is None or (
            super().has_room(size)
            and self.serial - self.first < SPAN - 1
            and self._sent_bytes - first.offset < SPAN_BYTES
        )

    @property
    def first(self) -> int:
        """Serial of the oldest unacknowledged notification, or of the next one."""
        return next(iter(self._items), self.serial + 1)

    @property
    def carries_structure(self) -> bool:
        """Whether a change of the structure is unacknowledged: the next one is relative to it."""
        return any(flight.notify.digest for flight in self)

    def send(self, notify: TreeNotify, parts: Parts, now_ns: int) -> TreeNotify:
        """Number a notification and keep it until it is acknowledged."""
        first = self.first
        self.serial += 1
        notify = msgspec.structs.replace(notify, serial=self.serial, lane=int(self.number), first=first)
        size = _bytes_of(notify)
        flight = UnacknowledgedNotification(notify, parts, self._sent_bytes, sent_ns=now_ns, size=size)
        self.add(self.serial, flight)
        self._sent_bytes += size
        return notify

    def due_ns(self) -> int | None:
        """Instant of the next retransmission, or None if nothing is to be sent again."""
        return self.backoff_until_ns if self.repeatable() else None

    def repeat(self, now_ns: int) -> Iterator[TreeNotify]:
        """Retransmit notifications whose sending failed; those for which there is no room follow when these
        are delivered."""
        first = self.first
        for serial in self.repeatable():
            yield msgspec.structs.replace(self.resend(serial, now_ns).notify, first=first)

    def delivered(self, serial: int, now_ns: int) -> UnacknowledgedNotification | None:
        """The notification was acknowledged; returns None for a duplicate of the acknowledgement."""
        flight = self.acknowledge(serial, now_ns)
        if flight is not None:
            for feed, items in flight.parts:
                feed.on_acknowledged(items, now_ns)
        return flight

    def failed(self, serial: int, now_ns: int, pauses_ns: tuple[int, ...]) -> bool:
        """The notification was not acknowledged in time; returns False if it is not in flight."""
        flight = self.fail(serial, now_ns, pauses_ns)
        if flight is None:
            return False
        _keep_ordered(flight)
        notify = flight.notify
        self.resize(flight, _bytes_of(notify))
        empty = not notify.items and not notify.digest and notify.limits is None
        if empty and serial == self.serial and len(self) == 1:
            self.drop(serial)  # the next one announces the gap
        return True

    def clear(self) -> None:
        """The subscriber has restarted: return what it may not have to the feeds."""
        for flight in reversed(list(self)):
            for feed, items in flight.parts:
                feed.requeue(items)
        super().clear()


def _keep_ordered(flight: UnacknowledgedNotification) -> None:
    """Remove boards, whose newest values follow, and former values; the rest keeps its serial.

    A duplicate must contain all events of the first copy, so only boards are removed.
    """
    for feed, items in flight.parts:
        if feed.latest_only:
            feed.requeue(items)
    flight.parts = [(feed, items) for feed, items in flight.parts if not feed.latest_only]
    rest = tuple(item for _, items in flight.parts for item in items)
    flight.notify = msgspec.structs.replace(flight.notify, items=rest)


def _bytes_of(notify: TreeNotify) -> int:
    return sum(len(item.data) for item in notify.items)
