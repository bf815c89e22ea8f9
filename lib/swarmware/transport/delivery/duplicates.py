"""The receiver's side: filters duplicates, and repeats their former answers."""

from collections import OrderedDict
from enum import Enum
from typing import Final

from swarmware.transport.retransmission.received_numbers import ReceivedNumbers

SPAN_BITS: Final = 10
"""Sequences are stored as one bit each, 1 024 in a span."""
SPANS: Final = 1024
"""Maximum spans of one hardware unit: a million messages within `HOLD_NS`, or 1 024 restarts."""
SENDERS: Final = 4096
"""Maximum hardware units, which bounds the memory that invented ids can take."""
HOLD_NS: Final = 60_000_000_000
"""Time for which a span is stored after its newest message: longer than any message waits for an answer."""
ANSWERS: Final = 32_768
ANSWER_BYTES: Final = 8 * 1024 * 1024
"""Maximum bytes of all cached answers; the oldest are dropped, their messages stay known."""
IN_WORK: Final = 4096
"""Maximum requests whose handlers have not answered yet."""

Origin = tuple[int, int, int, int]
"""Sender's hardware, sender's application, data id, sequence (each application starts at a random one)."""


class DuplicateState(Enum):
    """State of a duplicate that has no answer to repeat."""

    IN_WORK = 1
    """The handler has not answered yet."""
    ANSWER_GONE = 2
    """Answered, but the answer is no longer cached."""


class _Span(ReceivedNumbers):
    __slots__ = ("touched_ns",)

    def __init__(self, floor: int) -> None:
        super().__init__(floor)
        self.touched_ns = 0


_Place = tuple[int, int, int]
"""Application, data id, upper bits of the sequence."""


class DuplicateFilter:
    """Duplicate filter with a cache of answers, so that a duplicate gets the same answer.

    It stores one bit for each message for `hold_ns`. A restarted sender begins at a random
    sequence, so in other spans. The memory is bounded for each sender and in total: a flood displaces only
    the oldest of its own sender.
    """

    def __init__(
        self,
        hold_ns: int = HOLD_NS,
        *,
        spans: int = SPANS,
        senders: int = SENDERS,
        answers: int = ANSWERS,
        answer_bytes: int = ANSWER_BYTES,
    ) -> None:
        self._hold_ns = hold_ns
        self._spans = spans
        self._senders_limit = senders
        self._answers_limit = answers
        self._bytes_limit = answer_bytes
        # each in the order of last use
        self._senders: OrderedDict[int, OrderedDict[_Place, _Span]] = OrderedDict()
        self._answers: OrderedDict[Origin, bytes] = OrderedDict()
        self._in_work: OrderedDict[Origin, None] = OrderedDict()
        self._answer_bytes = 0
        self._now_ns = 0
        self.duplicates = 0
        """Messages that had been received before."""

    @property
    def spans(self) -> int:
        """Number of stored spans, which determines the memory."""
        return sum(map(len, self._senders.values()))

    def lookup(self, origin: Origin) -> bytes | DuplicateState | None:
        """The answer to this message, the state of a duplicate without an answer, or None if it is new."""
        hardware, application, data, sequence = origin
        spans = self._senders.get(hardware)
        place = (application, data, sequence >> SPAN_BITS)
        span = None if spans is None else spans.get(place)
        if spans is None or span is None or sequence not in span:
            return None
        self.duplicates += 1
        # a message that is still retransmitted must stay known
        self._touch(hardware, spans, place, span)
        if origin in self._in_work:
            return DuplicateState.IN_WORK
        return self._answers.get(origin, DuplicateState.ANSWER_GONE)

    def begin(self, origin: Origin, now_ns: int) -> None:
        """The message is accepted; its answer follows."""
        self._mark(origin, now_ns)
        self._in_work[origin] = None
        # A handler that never answers must not hold its entry for ever.
        if len(self._in_work) > IN_WORK:
            self._in_work.popitem(last=False)

    def answered(self, origin: Origin, answer: bytes, now_ns: int) -> None:
        """Store the answer; a message answered at once needs no `begin`."""
        self._mark(origin, now_ns)
        self._in_work.pop(origin, None)
        # A repeated answer replaces the former one, whose bytes no longer count.
        self._answer_bytes += len(answer) - len(self._answers.pop(origin, b""))
        self._answers[origin] = answer
        while self._answers and (
            self._answer_bytes > self._bytes_limit or len(self._answers) > self._answers_limit
        ):
            self._answer_bytes -= len(self._answers.popitem(last=False)[1])

    def _mark(self, origin: Origin, now_ns: int) -> None:
        # Never backwards, so that the order of last use stays the order of time.
        self._now_ns = max(self._now_ns, now_ns)
        hardware, application, data, sequence = origin
        spans = self._senders.get(hardware)
        if spans is None:
            self._forget_senders()
            spans = self._senders[hardware] = OrderedDict()
        place = (application, data, sequence >> SPAN_BITS)
        span = spans.get(place)
        if span is None:
            span = spans[place] = _Span(sequence >> SPAN_BITS << SPAN_BITS)
        span.add(sequence)
        self._touch(hardware, spans, place, span)
        oldest_ns = self._now_ns - self._hold_ns
        while len(spans) > self._spans or next(iter(spans.values())).touched_ns <= oldest_ns:
            spans.popitem(last=False)

    def _touch(self, hardware: int, spans: OrderedDict[_Place, _Span], place: _Place, span: _Span) -> None:
        span.touched_ns = self._now_ns
        spans.move_to_end(place)
        self._senders.move_to_end(hardware)

    def _forget_senders(self) -> None:
        """Remove senders silent for `hold_ns`, and the longest silent when there are too many."""
        oldest_ns = self._now_ns - self._hold_ns
        while self._senders:
            spans = next(iter(self._senders.values()))
            newest = spans[next(reversed(spans))]
            if newest.touched_ns > oldest_ns and len(self._senders) < self._senders_limit:
                return
            self._senders.popitem(last=False)
