"""One direction of a TCP connection over a radio: segments, acknowledgements, repetition, window.

Loss makes a connection slow instead of lossy, as TCP does: what is lost is repeated after a round trip or a
time-out, and the window is halved.
Source: RFC 5681 (window), RFC 6298 (time-out), RFC 8985 (loss by order of transmission).
"""

from collections import deque
from typing import Final

import msgspec

SEGMENT_BYTES: Final = 1448
"""Payload of a segment on Ethernet, with time stamps."""
BUFFER_BYTES: Final = 256 * 1024
"""Bytes that wait in a send buffer before its writer is paused."""
WINDOW_MAX: Final = 128
"""Segments on the way, about the receive buffer of a connection."""
WINDOW_START: Final = 10.0
REORDERING: Final = 3
"""Later transmissions that must have arrived before one counts as lost."""
TIMEOUT_MIN_S: Final = 0.2
TIMEOUT_START_S: Final = 1.0
TIMEOUT_MAX_S: Final = 60.0


class Segment(msgspec.Struct, frozen=True, gc=False):
    """A part of a connection's bytes. The first one, without bytes, opens it; another one without ends it."""

    sequence: int
    payload: bytes


class _Transmission(msgspec.Struct, gc=False):
    segment: Segment
    order: int
    sent_ns: int
    is_repeated: bool


class SegmentSender:
    """The sending end of one direction."""

    def __init__(self) -> None:
        self._waiting: deque[Segment] = deque()
        self._lost: dict[int, Segment] = {}
        """Segments that must be sent again, by sequence."""
        self._sent: dict[int, _Transmission] = {}
        """Segments on the way, in the order of their last transmission."""
        self._bytes = 0
        self._sequence = 0
        self._order = 0
        self._window = WINDOW_START
        self._threshold = float(WINDOW_MAX)
        """Window from which it grows by one segment a round trip."""
        self._recovery_order = 0
        """Transmissions before this one were sent with the window before it was halved."""
        self._round_trip_s = 0.0
        self._deviation_s = 0.0
        self._timeout_s = TIMEOUT_START_S
        self._backoff = 0
        self.is_held = False
        """Whether the receiver cannot take further bytes now."""

    @property
    def is_full(self) -> bool:
        """Whether its writer should pause."""
        return self._bytes >= BUFFER_BYTES

    @property
    def is_empty(self) -> bool:
        """Whether all segments have been acknowledged."""
        return not (self._waiting or self._sent or self._lost)

    def put(self, data: bytes) -> None:
        """Appends bytes; without any, the segment that opens or ends the connection."""
        for start in range(0, max(len(data), 1), SEGMENT_BYTES):
            self._waiting.append(Segment(self._sequence, data[start : start + SEGMENT_BYTES]))
            self._sequence += 1
        self._bytes += len(data)

    def take(self, now_ns: int) -> list[Segment]:
        """Segments to transmit now: lost ones first, then as many as the window allows."""
        found: list[Segment] = []
        while len(self._sent) < int(self._window) and (self._lost or (self._waiting and not self.is_held)):
            is_repeated = bool(self._lost)
            segment = self._lost.pop(min(self._lost)) if self._lost else self._waiting.popleft()
            self._order += 1
            self._sent[segment.sequence] = _Transmission(segment, self._order, now_ns, is_repeated)
            found.append(segment)
        return found

    def on_acknowledgement(self, missing: int, selected: int, now_ns: int) -> None:
        """All segments before `missing` have arrived, and the selected one."""
        answered = self._sent.get(selected)
        if answered is not None:
            self._backoff = 0
            if not answered.is_repeated:
                self._measure((now_ns - answered.sent_ns) / 1e9)
        for sequence in [one for one in (*self._sent, *self._lost) if one < missing or one == selected]:
            gone = self._sent.pop(sequence, None)
            self._bytes -= len(gone.segment.payload if gone else self._lost[sequence].payload)
            self._lost.pop(sequence, None)
            self._window += 1.0 if self._window < self._threshold else 1.0 / self._window
        self._window = min(self._window, WINDOW_MAX)
        if answered is not None:
            self._find_losses(answered.order)

    def deadline_ns(self) -> int | None:
        """Instant at which the oldest transmission counts as lost; None: nothing is on the way."""
        if not self._sent:
            return None
        oldest = next(iter(self._sent.values()))
        timeout_s = min(TIMEOUT_MAX_S, self._timeout_s * float(1 << self._backoff))
        return oldest.sent_ns + round(timeout_s * 1e9)

    def on_timer(self, now_ns: int) -> None:
        """After a time-out all segments on the way count as lost, and the window starts again with one."""
        due_ns = self.deadline_ns()
        if due_ns is None or due_ns > now_ns:
            return
        self._threshold = max(2.0, len(self._sent) / 2)
        self._window = 1.0
        self._backoff = min(self._backoff + 1, 10)
        self._recovery_order = self._order
        self._lost |= {sequence: one.segment for sequence, one in self._sent.items()}
        self._sent.clear()

    def _find_losses(self, order: int) -> None:
        for sequence, one in list(self._sent.items()):
            if order - one.order < REORDERING:
                break
            self._lost[sequence] = self._sent.pop(sequence).segment
            if one.order > self._recovery_order:
                self._recovery_order = self._order
                self._threshold = self._window = max(2.0, self._window / 2)

    def _measure(self, round_trip_s: float) -> None:
        if self._round_trip_s == 0:
            self._round_trip_s, self._deviation_s = round_trip_s, round_trip_s / 2
        else:
            self._deviation_s += (abs(round_trip_s - self._round_trip_s) - self._deviation_s) / 4
            self._round_trip_s += (round_trip_s - self._round_trip_s) / 8
        self._timeout_s = max(TIMEOUT_MIN_S, self._round_trip_s + 4 * self._deviation_s)


class SegmentReceiver:
    """The receiving end of one direction."""

    def __init__(self) -> None:
        self.missing = 0
        """Number of the first segment that has not arrived."""
        self._held: dict[int, bytes] = {}

    def on_segment(self, segment: Segment) -> list[Segment]:
        """Takes a segment; returns those that are next, in order."""
        if segment.sequence >= self.missing:
            self._held[segment.sequence] = segment.payload
        found = []
        while self.missing in self._held:
            found.append(Segment(self.missing, self._held.pop(self.missing)))
            self.missing += 1
        return found
