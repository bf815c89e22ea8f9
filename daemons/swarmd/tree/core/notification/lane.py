"""Notifications of one lane to one subscriber: a window of them, each retransmitted until acknowledged."""

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

import msgspec

from swarmd.tree.core.notification.board_history import BoardHistory
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.reorder_buffer import REORDER_WINDOW
from swarmware.runtime.backoff import pause_after
from swarmware.types.tree import TreeItem, TreeNotify

WINDOW: Final = 64
"""Maximum number of unacknowledged notifications; less than the inbox of the other tree holds."""
IN_FLIGHT_BYTES: Final = 256 * 1024
"""Maximum bytes of values in them; one notification is always sent."""
IN_FLIGHT_FIRST: Final = 64 * 1024
"""That maximum at first: half a second at 1 Mbit/s."""
IN_FLIGHT_MIN: Final = 8 * 1024
"""Least of it: each failure halves it, so that what a slow link has not sent is not sent twice."""
IN_FLIGHT_GROWTH: Final = 1 / 4
"""Part of the bytes of a delivered notification by which the maximum grows again."""
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


class UnacknowledgedNotification:
    """A notification that is sent and not acknowledged."""

    __slots__ = ("in_flight", "notify", "offset", "parts", "sent_ns", "size")

    def __init__(self, notify: TreeNotify, parts: Parts, sent_ns: int, offset: int) -> None:
        self.offset = offset
        """Bytes that the lane had sent before."""
        self.notify = notify
        self.parts = parts
        self.sent_ns = sent_ns
        self.size = sum(len(item.data) for item in notify.items)
        self.in_flight = True
        """False: it failed and waits for its retransmission."""

    def failed(self) -> None:
        """Remove its boards, whose newest values follow, and former values; the rest is retransmitted with
        the same serial.

        A duplicate must contain all events of the first copy, so only boards are removed.
        """
        self.in_flight = False
        ordered: Parts = []
        for feed, items in self.parts:
            if feed.latest_only:
                feed.requeue(items)
            else:
                ordered.append((feed, items))
        self.parts = ordered
        rest = tuple(item for _, items in ordered for item in items)
        self.notify = msgspec.structs.replace(self.notify, items=rest)


class NotificationLane:
    """Sends notifications with consecutive serials; the receiver restores their order."""

    __slots__ = (
        "_arrived_ns",
        "_failures",
        "_limit",
        "_sent_bytes",
        "_size",
        "_unacknowledged",
        "backoff_until_ns",
        "failing_since_ns",
        "number",
        "sent_ns",
        "serial",
    )

    def __init__(self, number: LaneNumber, serial: int = 0) -> None:
        """`serial`: of the notification before the first one."""
        self.number = number
        self.sent_ns = 0
        self.backoff_until_ns = 0
        """End of the back-off after a failure."""
        self.failing_since_ns: int | None = None
        """First failure since the last delivery; None: there was none."""
        self._arrived_ns = -(1 << 62)
        self._failures = 0
        self._limit = float(IN_FLIGHT_FIRST)
        """Bytes of values that may be unacknowledged."""
        self._unacknowledged: dict[int, UnacknowledgedNotification] = {}
        self._sent_bytes = 0
        self.serial = serial
        self._size = 0

    def __bool__(self) -> bool:
        """Whether a notification is unacknowledged."""
        return bool(self._unacknowledged)

    @property
    def has_room(self) -> bool:
        """Whether the window has room for a notification."""
        if not self._unacknowledged:
            return True
        first = next(iter(self._unacknowledged))
        return (
            len(self._unacknowledged) < WINDOW
            and self._size < self._limit
            and self.serial - first < SPAN - 1
            and self._sent_bytes - self._unacknowledged[first].offset < SPAN_BYTES
        )

    @property
    def carries_structure(self) -> bool:
        """Whether a change of the structure is unacknowledged: the next one is relative to it."""
        return any(flight.notify.digest for flight in self._unacknowledged.values())

    def send(self, notify: TreeNotify, parts: Parts, now_ns: int) -> TreeNotify:
        """Number a notification and keep it until it is acknowledged."""
        self.serial += 1
        first = next(iter(self._unacknowledged), self.serial)
        notify = msgspec.structs.replace(notify, serial=self.serial, lane=int(self.number), first=first)
        flight = self._unacknowledged[self.serial] = UnacknowledgedNotification(
            notify, parts, now_ns, self._sent_bytes
        )
        self._size += flight.size
        self._sent_bytes += flight.size
        self.sent_ns = now_ns
        return notify

    def due_ns(self) -> int | None:
        """When a retransmission is due; None: none is."""
        return self.backoff_until_ns if self._repeatable() else None

    def repeat(self, now_ns: int) -> Iterator[TreeNotify]:
        """Retransmit notifications whose sending failed; those for which there is no room follow when these
        are delivered."""
        first = next(iter(self._unacknowledged), 0)
        for flight in self._repeatable():
            flight.in_flight = True
            flight.sent_ns = now_ns
            yield msgspec.structs.replace(flight.notify, first=first)

    def _repeatable(self) -> list[UnacknowledgedNotification]:
        """The oldest ones whose sending failed, as many as the maximum in flight permits.

        All of them at once would fail again on a slow link, for ever.
        """
        failed = [flight for flight in self._unacknowledged.values() if not flight.in_flight]
        size, found = self._size - sum(flight.size for flight in failed), list[UnacknowledgedNotification]()
        for flight in failed:
            if size and size + flight.size > self._limit:
                break
            size += flight.size
            found.append(flight)
        return found

    def delivered(self, serial: int, now_ns: int) -> UnacknowledgedNotification | None:
        """The notification was acknowledged; None: it was before."""
        flight = self._unacknowledged.pop(serial, None)
        if flight is not None:
            self._size -= flight.size
            self._arrived_ns = now_ns
            self._limit = min(self._limit + IN_FLIGHT_GROWTH * flight.size, IN_FLIGHT_BYTES)
            self.reset_backoff()
            for feed, items in flight.parts:
                feed.on_acknowledged(items, now_ns)
        return flight

    def failed(self, serial: int, now_ns: int, pauses_ns: tuple[int, ...]) -> bool:
        """It was not acknowledged in time; False: it is not in flight."""
        flight = self._unacknowledged.get(serial)
        if flight is None or not flight.in_flight:
            return False
        if self.failing_since_ns is None:
            self.failing_since_ns = now_ns
        # if a later one was delivered since, only this one was lost: retransmit at once
        if flight.sent_ns >= self._arrived_ns and now_ns >= self.backoff_until_ns:
            self._limit = max(self._limit / 2, IN_FLIGHT_MIN)
            self._failures += 1
            self.backoff_until_ns = now_ns + pause_after(self._failures, pauses_ns)
        self._size -= flight.size
        flight.failed()
        flight.size = sum(len(item.data) for item in flight.notify.items)
        self._size += flight.size
        notify = flight.notify
        empty = not notify.items and not notify.digest and notify.limits is None
        if empty and serial == self.serial and len(self._unacknowledged) == 1:
            del self._unacknowledged[serial]  # the next one announces the gap
        return True

    def reset_backoff(self) -> None:
        """The subscriber is reachable: end the back-off."""
        self.backoff_until_ns = self._failures = 0
        self.failing_since_ns = None

    def clear(self) -> None:
        """The subscriber has restarted: return what it may not have to the feeds."""
        for flight in reversed(self._unacknowledged.values()):
            for feed, items in flight.parts:
                feed.requeue(items)
        self._unacknowledged.clear()
        self._size = 0
        self.reset_backoff()
