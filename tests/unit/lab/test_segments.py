"""A TCP connection over a radio in virtual time: order, repetition, time-outs and window."""

import heapq
import random
from collections.abc import Callable

import pytest

from swarmlab.radio.core.segments import (
    BUFFER_BYTES,
    SEGMENT_BYTES,
    TIMEOUT_MIN_S,
    WINDOW_MAX,
    Segment,
    SegmentReceiver,
    SegmentSender,
)

MS = 1_000_000
SECOND = 1000 * MS


class Connection:
    """Both ends of a direction, and a link that loses what the test says."""

    def __init__(self, is_lost: Callable[[int], bool], delay_ns: int = 10 * MS) -> None:
        self.sender, self.receiver = SegmentSender(), SegmentReceiver()
        self.now_ns = 0
        self.transmitted: list[int] = []
        self.delivered: list[Segment] = []
        self._is_lost = is_lost
        self._delay_ns = delay_ns
        self._due: list[tuple[int, int, Segment]] = []

    def run(self, until_ns: int = 600 * SECOND) -> None:
        """Until everything has been acknowledged, or the time is over."""
        while not self.sender.is_empty and self.now_ns < until_ns:
            self._transmit()
            times = [self._due[0][0]] if self._due else []
            if (due_ns := self.sender.deadline_ns()) is not None:
                times.append(due_ns)
            self.now_ns = min(*times, until_ns) if times else until_ns
            self.sender.on_timer(self.now_ns)
            while self._due and self._due[0][0] <= self.now_ns:
                segment = heapq.heappop(self._due)[2]
                self.delivered += self.receiver.on_segment(segment)
                self.sender.on_acknowledgement(self.receiver.missing, segment.sequence, self.now_ns)

    def _transmit(self) -> None:
        for segment in self.sender.take(self.now_ns):
            self.transmitted.append(segment.sequence)
            if not self._is_lost(len(self.transmitted)):
                number = len(self.transmitted)
                heapq.heappush(self._due, (self.now_ns + 2 * self._delay_ns + number, number, segment))

    @property
    def data(self) -> bytes:
        return b"".join(segment.payload for segment in self.delivered)


@pytest.mark.parametrize("loss_ratio", [0.0, 0.1, 0.4])
def test_all_bytes_arrive_once_and_in_order_whatever_is_lost(loss_ratio: float) -> None:
    chance = random.Random(7).random
    connection = Connection(lambda _: chance() < loss_ratio)
    data = random.Random(8).randbytes(300_000)
    connection.sender.put(data)
    connection.run()
    assert connection.data == data
    assert connection.sender.is_empty
    sent = len(connection.transmitted)
    assert sent == len(connection.delivered) if not loss_ratio else sent > len(connection.delivered)


def test_a_lost_segment_is_repeated_after_a_round_trip_and_the_window_is_halved_once() -> None:
    connection = Connection({2, 4}.__contains__)
    connection.sender.put(bytes(20 * SEGMENT_BYTES))
    connection.run()
    assert connection.now_ns < 100 * MS, "no time-out was needed"
    assert sorted(connection.transmitted) == sorted([*range(20), 1, 3])


def test_without_an_answer_the_time_outs_become_longer_and_one_segment_is_sent_at_a_time() -> None:
    connection = Connection(lambda _: True)
    connection.sender.put(bytes(5 * SEGMENT_BYTES))
    connection.run(until_ns=16 * SECOND)
    # five at 0 s, then the first one after 1, 3, 7 and 15 s
    assert connection.transmitted == [0, 1, 2, 3, 4, 0, 0, 0, 0]


def test_after_an_outage_the_rest_arrives() -> None:
    connection = Connection(lambda _: connection.now_ns < 5 * SECOND)
    connection.sender.put(b"x" * 50_000)
    connection.run()
    assert connection.data == b"x" * 50_000
    assert connection.now_ns < 12 * SECOND


def test_the_time_out_follows_the_round_trip() -> None:
    connection = Connection(lambda _: False, delay_ns=1 * MS)
    connection.sender.put(bytes(100 * SEGMENT_BYTES))
    connection.run()
    connection.sender.put(b"last")
    connection.sender.take(connection.now_ns)
    due_ns = connection.sender.deadline_ns()
    assert due_ns == connection.now_ns + round(TIMEOUT_MIN_S * 1e9)


def test_the_window_is_bounded_and_a_held_receiver_gets_nothing_new() -> None:
    connection = Connection(lambda _: False)
    connection.sender.put(bytes(1000 * SEGMENT_BYTES))
    assert connection.sender.is_full
    connection.run()
    connection.sender.put(bytes(1000 * SEGMENT_BYTES))
    assert len(connection.sender.take(connection.now_ns)) == WINDOW_MAX
    connection.sender.is_held = True
    connection.sender.on_timer(connection.now_ns + 10 * SECOND)
    repeated = connection.sender.take(connection.now_ns + 10 * SECOND)
    assert [segment.sequence for segment in repeated] == [1000]


def test_an_empty_segment_opens_and_another_one_ends_a_connection() -> None:
    connection = Connection(lambda number: number == 1)
    connection.sender.put(b"")
    connection.sender.put(b"text")
    connection.sender.put(b"")
    connection.run()
    assert [(one.sequence, one.payload) for one in connection.delivered] == [(0, b""), (1, b"text"), (2, b"")]


def test_segments_that_arrive_twice_are_delivered_once() -> None:
    receiver = SegmentReceiver()
    assert receiver.on_segment(Segment(1, b"b")) == []
    assert receiver.on_segment(Segment(0, b"a")) == [Segment(0, b"a"), Segment(1, b"b")]
    assert receiver.on_segment(Segment(0, b"a")) == []
    assert receiver.missing == 2


def test_a_full_buffer_has_room_again_when_its_bytes_have_been_acknowledged() -> None:
    sender = SegmentSender()
    sender.put(bytes(BUFFER_BYTES))
    assert sender.is_full
    first = sender.take(0)
    sender.on_acknowledgement(len(first), len(first) - 1, MS)
    assert not sender.is_full
