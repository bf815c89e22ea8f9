"""Published boards of this node: selects the values of each beacon by change, period and waiting time."""

from collections.abc import Callable, Iterable
from typing import Final

from swarmd.broker.core.beacon.beacon import NEVER_NS, BoardValue
from swarmd.broker.core.beacon.beacon_codec import value_bytes
from swarmware.types.net import BoardPublication

REFRESH_NS: Final = 1_000_000_000
"""Period in which an unchanged value is repeated: for lost datagrams and new readers."""
REPEATS: Final = 3
"""Consecutive beacons that carry a change: with 10 % loss all three are lost once in a thousand."""
_ALWAYS_NS: Final = 1


class PublishedBoard:
    """A board with remote subscribers: newest value and state of sending."""

    __slots__ = (
        "data_id",
        "held_back",
        "limited",
        "packed",
        "path",
        "payload",
        "period_ns",
        "repeats",
        "sent_ns",
        "sent_version",
        "stamp_ns",
        "type",
        "version",
    )

    def __init__(self, offer: BoardPublication) -> None:
        self.path = offer.path
        self.data_id = offer.data_id
        self.type = offer.type
        self.period_ns = _ALWAYS_NS
        self.limited = False
        """A rate limit gives the period, rather than the subscription."""
        self.payload = b""
        self.packed = False
        self.stamp_ns = 0
        self.version = 0
        """Number of values put, or 0 before the first."""
        self.sent_version = 0
        self.repeats = 0
        """Beacons that still have to carry the newest payload."""
        self.held_back = 0
        """Values replaced by newer ones because of a rate limit."""
        self.sent_ns = NEVER_NS

    def put(self, payload: bytes, packed: bool, stamp_ns: int) -> None:
        """Takes the newest value; an unchanged payload with a later stamp triggers no beacon."""
        # the former value was not sent yet and never will be
        if self.limited and self.version != self.sent_version:
            self.held_back += 1
        # several beacons carry a change, because a beacon is never repeated
        if payload != self.payload or packed != self.packed:
            self.repeats = REPEATS
        self.payload = payload
        self.packed = packed
        self.stamp_ns = stamp_ns
        self.version += 1


class PublishedBoards:
    """All boards of this node that have remote subscribers."""

    def __init__(self) -> None:
        self.boards: dict[int, PublishedBoard] = {}
        """Boards by data id."""

    def offer(
        self, offers: Iterable[BoardPublication], max_hz: Callable[[BoardPublication], float | None]
    ) -> None:
        """Sets the published boards and their rates: by a rule of channels, else by the offered interval."""
        boards: dict[int, PublishedBoard] = {}
        for offer in offers:
            # kept over changes of the plan; its newest value need not be written again
            board = self.boards.get(offer.data_id) or PublishedBoard(offer)
            board.period_ns = max(offer.min_interval_ms * 1_000_000, _ALWAYS_NS)
            board.limited = False
            limit_hz = max_hz(offer)
            if limit_hz is not None:
                limit_ns = round(1e9 / limit_hz) if limit_hz > 0 else 0
                board.limited = limit_ns == 0 or limit_ns > board.period_ns
                board.period_ns = limit_ns
            boards[offer.data_id] = board
        self.boards = boards

    def values(self, now_ns: int, room: int, beacon_period_ns: int) -> list[BoardValue]:
        """Values for the next beacon in at most `room` bytes, the longest waiting first.

        `beacon_period_ns`: time between two beacons; a period that ends within half of it is over, or a value
        of 10 Hz would miss every second beacon.
        """
        due = self._due(now_ns, beacon_period_ns)
        due.sort(key=_waited, reverse=True)
        values: list[BoardValue] = []
        for _, board in due:
            size = value_bytes(board.payload)
            # a smaller value behind it may still fit
            if size > room:
                continue
            room -= size
            board.sent_version = board.version
            board.sent_ns = now_ns
            board.repeats = max(0, board.repeats - 1)
            age_us = (now_ns - board.stamp_ns) // 1000
            values.append(BoardValue(board.data_id, age_us, board.packed, board.payload))
        return values

    def has_changes(self, now_ns: int, beacon_period_ns: int, max_wait_ns: int) -> bool:
        """Whether some board has changed and is due; one of a longer period than `patience_ns` can wait."""
        return any(
            board.repeats
            and board.version != board.sent_version
            and 0 < board.period_ns < max_wait_ns
            and now_ns - board.sent_ns + beacon_period_ns // 2 >= board.period_ns
            for board in self.boards.values()
        )

    def _due(self, now_ns: int, beacon_period_ns: int) -> list[tuple[float, PublishedBoard]]:
        due: list[tuple[float, PublishedBoard]] = []
        for board in self.boards.values():
            if not board.version or not board.period_ns:
                continue
            waited_ns = now_ns - board.sent_ns + beacon_period_ns // 2
            changed = board.version != board.sent_version
            # an unchanged value is refreshed now and then, for nodes that missed it
            period_ns = board.period_ns if changed else max(REFRESH_NS, board.period_ns)
            if waited_ns >= period_ns:
                due.append((waited_ns / max(period_ns, beacon_period_ns), board))
        return due


def _waited(entry: tuple[float, PublishedBoard]) -> float:
    return entry[0]
