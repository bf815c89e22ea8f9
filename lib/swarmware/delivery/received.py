"""The receiver's side: what was received already, and what was answered to it."""

from enum import Enum
from typing import Final

CAPACITY: Final = 4096
"""Entries kept; a sender has at most 256 unanswered messages of one data id, see `post`."""
HOLD_NS: Final = 60_000_000_000
"""How long an entry is kept when there is room: longer than any message waits for an answer."""
ANSWER_BYTES: Final = 8 * 1024 * 1024
"""Cached answers together; beyond it the oldest are dropped, their entries stay."""

Origin = tuple[int, int, int, int]
"""Sender's hardware, sender's application, data id, sequence (each application starts at a random one)."""


class Seen(Enum):
    """A message that was received before and has no answer to repeat."""

    IN_WORK = 1
    """The handler has not answered yet."""
    ANSWER_GONE = 2
    """Answered, but the answer is no longer held."""


class Received:
    """Duplicate filter with the answers given, so that a repeated question gets the same one."""

    def __init__(
        self, capacity: int = CAPACITY, hold_ns: int = HOLD_NS, answer_bytes: int = ANSWER_BYTES
    ) -> None:
        self._capacity = capacity
        self._hold_ns = hold_ns
        self._answer_limit = answer_bytes
        self._entries: dict[Origin, tuple[int, bytes | Seen]] = {}  # in order of arrival
        self._answer_bytes = 0
        self.duplicates = 0
        """Messages that had been received before."""

    def __len__(self) -> int:
        return len(self._entries)

    def look(self, origin: Origin) -> bytes | Seen | None:
        """The answer given to this message, or what is known of it; None when it is new."""
        entry = self._entries.get(origin)
        if entry is None:
            return None
        self.duplicates += 1
        return entry[1]

    def begin(self, origin: Origin, now_ns: int) -> None:
        """The message is accepted; its answer follows."""
        self._make_room(now_ns)
        self._entries[origin] = (now_ns, Seen.IN_WORK)

    def answered(self, origin: Origin, answer: bytes, now_ns: int) -> None:
        """This was the answer; a message answered at once needs no `begin`."""
        entry = self._entries.get(origin)
        if entry is None:
            self._make_room(now_ns)
        else:
            now_ns = entry[0]
        self._entries[origin] = (now_ns, answer)
        self._answer_bytes += len(answer)
        if self._answer_bytes > self._answer_limit:
            self._drop_answers()

    def _make_room(self, now_ns: int) -> None:
        entries = self._entries
        while entries:
            origin = next(iter(entries))
            if len(entries) < self._capacity and now_ns - entries[origin][0] < self._hold_ns:
                return
            answer = entries.pop(origin)[1]
            if isinstance(answer, bytes):
                self._answer_bytes -= len(answer)

    def _drop_answers(self) -> None:
        for origin, (received_ns, answer) in self._entries.items():
            if self._answer_bytes <= self._answer_limit // 2:
                return
            if isinstance(answer, bytes):
                self._answer_bytes -= len(answer)
                self._entries[origin] = (received_ns, Seen.ANSWER_GONE)
