"""The jitter buffer: order is restored within the wait; then a missing packet is a gap."""

from swarmd.video.core.jitter_buffer import PACKETS_MAX, JitterBuffer, OrderedPacket
from swarmd.video.core.rtp_packet import RtpPacket

MS = 1_000_000


def packet(number: int) -> RtpPacket:
    return RtpPacket(number & 0xFFFF, number, 7, b"\x41")


def numbers(found: list[OrderedPacket]) -> list[tuple[int, int]]:
    """Number, and packets lost before it."""
    return [(one.packet.timestamp, one.lost) for one in found]


def put(buffer: JitterBuffer, number: int, at_ms: int) -> list[tuple[int, int]]:
    return numbers(buffer.put(number, packet(number), at_ms * MS))


def test_packets_in_order_pass_at_once() -> None:
    buffer = JitterBuffer(40 * MS)
    assert [put(buffer, number, 0) for number in (10, 11)] == [[(10, 0)], [(11, 0)]]
    assert buffer.deadline_ns() is None


def test_an_overtaken_packet_is_waited_for() -> None:
    buffer = JitterBuffer(40 * MS)
    put(buffer, 10, 0)
    assert put(buffer, 12, 5) == put(buffer, 13, 6) == []
    assert buffer.deadline_ns() == 45 * MS
    assert put(buffer, 11, 7) == [(11, 0), (12, 0), (13, 0)]


def test_missing_packet_is_gap_after_wait() -> None:
    buffer = JitterBuffer(40 * MS)
    put(buffer, 10, 0)
    put(buffer, 13, 5)
    assert numbers(buffer.on_due(44 * MS)) == []
    assert numbers(buffer.on_due(45 * MS)) == [(13, 2)]
    assert put(buffer, 11, 50) == []
    assert (buffer.late, buffer.duplicates) == (1, 0)
    assert put(buffer, 14, 51) == [(14, 0)]


def test_a_packet_counts_once() -> None:
    buffer = JitterBuffer(40 * MS)
    put(buffer, 10, 0)
    put(buffer, 12, 1)
    assert put(buffer, 12, 2) == put(buffer, 10, 2) == []
    assert (buffer.late, buffer.duplicates) == (1, 1)


def test_waits_never_exceed_room() -> None:
    buffer = JitterBuffer(40 * MS)
    put(buffer, 0, 0)
    found = [put(buffer, number, 1) for number in range(2, PACKETS_MAX + 2)]
    assert found[:-1] == [[]] * (PACKETS_MAX - 1)
    assert found[-1][0] == (2, 1)
    assert len(found[-1]) == PACKETS_MAX


def test_nothing_is_due_before_the_first_packet() -> None:
    buffer = JitterBuffer(40 * MS)
    assert buffer.on_due(0) == []
    assert buffer.deadline_ns() is None


def test_another_beginning_is_no_loss() -> None:
    buffer = JitterBuffer(40 * MS)
    put(buffer, 10, 0)
    assert put(buffer, 40_000, 1) == [(40_000, 0)]
    assert put(buffer, 10, 2) == [(10, 0)]
