"""Which packets arrived, and when they are acknowledged."""

from itertools import pairwise
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.frames.reliable.packet import RANGES_MAX
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS, ReceivedPackets

T = 5_000_000_000


def ranges_of(received: ReceivedPackets) -> tuple[tuple[int, int], ...]:
    found = received.present(T)
    assert found is not None
    return found.ranges


@given(st.lists(st.integers(0, 40), min_size=1, unique=True))
def test_the_ranges_are_exactly_what_arrived(numbers: list[int]) -> None:
    received = ReceivedPackets()
    for number in numbers:
        received.on_packet(number, True, T)
    ranges = ranges_of(received)
    assert {number for first, last in ranges for number in range(first, last + 1)} == set(numbers)
    assert all(after[1] < before[0] - 1 for before, after in pairwise(ranges))


def due_ns(received: ReceivedPackets) -> int | None:
    return received.due_ns


def test_the_newest_ranges_are_kept() -> None:
    received = ReceivedPackets()
    for number in range(0, 200, 2):
        received.on_packet(number, True, T)
    assert ranges_of(received) == tuple((198 - 2 * at, 198 - 2 * at) for at in range(RANGES_MAX))


def test_one_packet_is_acknowledged_late_two_at_once() -> None:
    received = ReceivedPackets()
    received.on_packet(0, True, T)
    assert due_ns(received) == T + ACK_DELAY_NS
    received.on_packet(1, True, T + 1)
    assert due_ns(received) == T + 1
    received.on_acknowledged()
    assert due_ns(received) is None
    assert received.present(T) is None


def test_a_gap_is_told_at_once() -> None:
    received = ReceivedPackets()
    received.on_packet(0, True, T)
    received.on_acknowledged()
    received.on_packet(2, True, T)
    assert received.due_ns == T


def test_acknowledgements_are_not_acknowledged() -> None:
    received = ReceivedPackets()
    received.on_packet(0, False, T)
    assert received.due_ns is None
    assert received.present(T) is None


def test_the_delay_is_that_of_the_newest_packet() -> None:
    received = ReceivedPackets()
    received.on_packet(3, True, T)
    received.on_packet(1, True, T + 1000)
    found = received.present(T + 5000)
    assert found is not None
    assert found.delay_ns == 5000
    assert found.largest == 3


def test_any_order_gives_the_same_ranges() -> None:
    numbers = [number for number in range(60) if number % 7]
    expected: tuple[tuple[int, int], ...] | None = None
    for seed in range(20):
        Random(seed).shuffle(numbers)
        received = ReceivedPackets()
        for number in numbers:
            received.on_packet(number, True, T)
        expected = expected or ranges_of(received)
        assert ranges_of(received) == expected
