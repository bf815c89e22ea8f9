"""Notifications of one lane on their way to one subscriber: a window of them, each sent until it is there."""

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

import msgspec

from swarmd.tree.core.arrivals import AHEAD
from swarmd.tree.core.feed import Feed
from swarmware.types.tree import TreeItem, TreeNotify

WINDOW: Final = 64
"""Notifications without an acknowledgement; less than the inbox of the other tree holds."""
FLIGHT_BYTES: Final = 256 * 1024
"""Of values in them, except that one notification always has room."""
SPAN: Final = AHEAD
"""Serials from the oldest without an acknowledgement on: the receiver may hold all others back for it."""
SPAN_BYTES: Final = 1024 * 1024
TOGETHER_NS: Final = 20_000_000
"""While one is under way, what comes within this goes together in the next."""


class Number(IntEnum):
    """What a lane is for: streams must not hold up what is small and matters."""

    NEWS = 0
    """Boards, events, changes of the structure."""
    STREAMS = 1


Parts = list[tuple[Feed, list[TreeItem]]]


class Flight:
    """One notification that is not acknowledged yet."""

    __slots__ = ("begins", "notify", "parts", "sent_ns", "size", "under_way")

    def __init__(self, notify: TreeNotify, parts: Parts, sent_ns: int, begins: int) -> None:
        self.begins = begins
        """Bytes that the lane had launched before."""
        self.notify = notify
        self.parts = parts
        self.sent_ns = sent_ns
        self.size = sum(len(item.data) for item in notify.items)
        self.under_way = True
        """False: it failed and waits for its repetition."""

    def failed(self) -> None:
        """Its boards will come with their newest values; the rest is sent again under the same serial.

        What arrives twice must not say less the first time, so it only ever loses boards.
        """
        self.under_way = False
        ordered: Parts = []
        for feed, items in self.parts:
            if feed.boardlike:
                feed.put_back(items)
            else:
                ordered.append((feed, items))
        self.parts = ordered
        rest = tuple(item for _, items in ordered for item in items)
        self.notify = msgspec.structs.replace(self.notify, items=rest)


class Lane:
    """Serials without gaps; the receiver puts the notifications in their order."""

    __slots__ = (
        "_arrived_ns",
        "_failures",
        "_flights",
        "_launched",
        "_size",
        "failing_ns",
        "number",
        "quiet_ns",
        "sent_ns",
        "serial",
    )

    def __init__(self, number: Number, serial: int = 0) -> None:
        """`serial`: of the last notification before."""
        self.number = number
        self.sent_ns = 0
        self.quiet_ns = 0
        """Nothing is sent before: something failed."""
        self.failing_ns: int | None = None
        """Since when nothing arrives; None: the newest thing known is that something did."""
        self._arrived_ns = -(1 << 62)
        self._failures = 0
        self._flights: dict[int, Flight] = {}
        self._launched = 0
        self.serial = serial
        self._size = 0

    def __bool__(self) -> bool:
        """Whether something is not acknowledged yet."""
        return bool(self._flights)

    @property
    def has_room(self) -> bool:
        """Whether one more may be sent."""
        if not self._flights:
            return True
        first = next(iter(self._flights))
        return (
            len(self._flights) < WINDOW
            and self._size < FLIGHT_BYTES
            and self.serial - first < SPAN - 1
            and self._launched - self._flights[first].begins < SPAN_BYTES
        )

    @property
    def carries_structure(self) -> bool:
        """Whether a change of the structure is under way: the next one builds on it."""
        return any(flight.notify.digest for flight in self._flights.values())

    def launch(self, notify: TreeNotify, parts: Parts, now_ns: int) -> TreeNotify:
        """The notification with its place in the lane; it is kept until it is acknowledged."""
        self.serial += 1
        first = next(iter(self._flights), self.serial)
        notify = msgspec.structs.replace(notify, serial=self.serial, lane=int(self.number), first=first)
        flight = self._flights[self.serial] = Flight(notify, parts, now_ns, self._launched)
        self._size += flight.size
        self._launched += flight.size
        self.sent_ns = now_ns
        return notify

    def due_ns(self) -> int | None:
        """From when on something is to be repeated."""
        waits = any(not flight.under_way for flight in self._flights.values())
        return self.quiet_ns if waits else None

    def repeat(self, now_ns: int) -> Iterator[TreeNotify]:
        """What failed, again."""
        first = next(iter(self._flights), 0)
        for flight in self._flights.values():
            if not flight.under_way:
                flight.under_way = True
                flight.sent_ns = now_ns
                yield msgspec.structs.replace(flight.notify, first=first)

    def delivered(self, serial: int, now_ns: int) -> Flight | None:
        """The notification arrived; None: it is known already."""
        flight = self._flights.pop(serial, None)
        if flight is not None:
            self._size -= flight.size
            self._arrived_ns = now_ns
            self.hurry()
            for feed, _ in flight.parts:
                feed.arrived()
        return flight

    def failed(self, serial: int, now_ns: int, pauses_ns: tuple[int, ...]) -> bool:
        """It did not arrive, as far as anybody knows; False: it is known to have."""
        flight = self._flights.get(serial)
        if flight is None or not flight.under_way:
            return False
        if self.failing_ns is None:
            self.failing_ns = now_ns
        # where others got through since it was sent, it had bad luck and is sent again at once
        if flight.sent_ns >= self._arrived_ns and now_ns >= self.quiet_ns:
            self.quiet_ns = now_ns + pauses_ns[min(self._failures, len(pauses_ns) - 1)]
            self._failures += 1
        self._size -= flight.size
        flight.failed()
        flight.size = sum(len(item.data) for item in flight.notify.items)
        self._size += flight.size
        empty = not flight.notify.items and not flight.notify.digest
        if empty and serial == self.serial and len(self._flights) == 1:
            del self._flights[serial]  # the next one says that it is not waited for
        return True

    def hurry(self) -> None:
        """The subscriber is there: no more waiting because of what failed before."""
        self.quiet_ns = self._failures = 0
        self.failing_ns = None

    def clear(self) -> None:
        """The subscriber has forgotten all: what it may not have goes back to where it came from."""
        for flight in reversed(self._flights.values()):
            for feed, items in flight.parts:
                feed.put_back(items)
        self._flights.clear()
        self._size = 0
        self.hurry()
