"""Pacing of a serial line: nothing is written before the line can send it; beacons leave room for others."""

from itertools import pairwise

import pytest

from swarmd.broker.core.swarm.media.line_frames import BITS, LineReceiver, LineSender, line_bytes
from swarmd.broker.core.swarm.media.line_queue import LEAD_NS, QUEUE_MIN, QUEUE_NS, LineQueue

SECOND = 1_000_000_000
BAUD = 9600
BYTE_NS = BITS * SECOND / BAUD


def duration_ns(datagram: bytes) -> int:
    return round(line_bytes(len(datagram)) * BYTE_NS)


def drain(queue: LineQueue, now_ns: int, until_ns: int) -> list[tuple[int, bytes]]:
    """What is written, and when, by somebody who waits for each deadline."""
    written: list[tuple[int, bytes]] = []
    while (due_ns := queue.deadline_ns(now_ns)) is not None and due_ns <= until_ns:
        now_ns = max(now_ns, due_ns)
        datagram = queue.take(now_ns)
        assert datagram is not None, "a deadline is one"
        written.append((now_ns, datagram))
    return written


def test_a_line_is_written_at_its_pace() -> None:
    queue, packets = LineQueue(BAUD), [bytes([number]) * 90 for number in range(QUEUE_MIN)]
    for packet in packets:
        assert queue.put(packet, urgent=False)
    written = drain(queue, 0, 10 * SECOND)
    assert [datagram for _, datagram in written] == packets
    for (first_ns, datagram), (next_ns, _) in pairwise(written):
        assert next_ns - first_ns >= duration_ns(datagram) - LEAD_NS
    assert written[-1][0] <= 3 * duration_ns(packets[0]), "and no slower"


def test_urgent_frames_pass_packets_and_beacons_pass_both() -> None:
    queue = LineQueue(BAUD)
    queue.put(b"packet", urgent=False)
    queue.put(b"urgent", urgent=True)
    queue.put_beacon(b"beacon")
    assert [datagram for _, datagram in drain(queue, 0, SECOND)] == [b"beacon", b"urgent", b"packet"]


def test_beacons_take_half_of_line_and_newest_leaves() -> None:
    queue, written = LineQueue(BAUD), list[bytes]()
    beacon_bytes = 100
    for tick in range(100):  # 10 Hz, of which the line could carry nine
        now_ns = tick * SECOND // 10
        queue.put_beacon(bytes([tick]) * beacon_bytes)
        for _ in range(5):
            queue.put(b"x" * 30, urgent=False)
        while (due_ns := queue.deadline_ns(now_ns)) is not None and due_ns < now_ns + SECOND // 10:
            now_ns = max(now_ns, due_ns)
            datagram = queue.take(now_ns)
            assert datagram is not None
            written.append(datagram)
    beacons = [datagram for datagram in written if len(datagram) == beacon_bytes]
    line = sum(map(duration_ns, written))
    assert 0.4 < sum(map(duration_ns, beacons)) / line < 0.55
    assert line == pytest.approx(10 * SECOND, rel=0.05), "the line is never idle"
    assert queue.replaced_beacons == pytest.approx(100 - len(beacons), abs=1)
    assert [one[0] for one in beacons] == sorted({one[0] for one in beacons})


def test_packets_beyond_half_second_are_refused_and_counted() -> None:
    queue = LineQueue(BAUD)
    taken = sum(queue.put(b"x" * 50, urgent=False) for _ in range(100))
    assert taken == QUEUE_NS // duration_ns(b"x" * 50)
    assert queue.dropped == 100 - taken
    assert queue.put(b"now", urgent=True), "urgent frames have room of their own"


def test_packets_queued_for_unplugged_line_are_dropped() -> None:
    queue = LineQueue(BAUD)
    queue.put_beacon(b"old")
    queue.put(b"old", urgent=True)
    queue.clear()
    assert queue.deadline_ns(0) is None
    assert queue.take(SECOND) is None


def test_numbers_of_line_rise_and_arrive_with_datagrams() -> None:
    sender, receiver = LineSender(), LineReceiver()
    line = b"".join(sender.frame(bytes([number])) for number in range(3))
    assert list(receiver.feed(line)) == [(0, b"\x00"), (1, b"\x01"), (2, b"\x02")]


def test_frame_without_datagram_is_refused_by_name() -> None:
    sender, receiver = LineSender(), LineReceiver()
    assert list(receiver.feed(sender.frame(b""))) == []
    assert receiver.refused == {"no datagram": 1}


@pytest.mark.parametrize("size", [1, 250, 252, 253, 1238])
def test_the_length_on_the_line_is_known_before(size: int) -> None:
    assert (
        len(LineSender().frame(b"x" * size)) <= line_bytes(size) <= len(LineSender().frame(b"x" * size)) + 1
    )
