"""Which numbers have arrived, in any order and with gaps."""

from hypothesis import given
from hypothesis import strategies as st

from swarmware.transport.retransmission.received_numbers import ReceivedNumbers


@given(st.lists(st.integers(0, 300)), st.integers(0, 300))
def test_each_number_is_new_once(numbers: list[int], floor: int) -> None:
    received, seen = ReceivedNumbers(floor), set(range(floor))
    for number in numbers:
        assert (number in received) == (number in seen)
        received.add(number)
        seen.add(number)


@given(st.lists(st.integers(0, 1 << 64), min_size=1), st.integers(1, 70))
def test_span_bounds_memory_and_refuses_older_numbers(numbers: list[int], span: int) -> None:
    received, seen = ReceivedNumbers(span=span), set[int]()
    for number in [*numbers, *(number + 3 for number in numbers)]:
        is_old = bool(seen) and number <= max(seen) - span
        assert (number in received) == (number in seen or is_old)
        received.add(number)
        seen.add(number)
        assert received.floor == max(0, max(seen) - span + 1)


def test_raised_floor_never_falls() -> None:
    received = ReceivedNumbers()
    received.add(5)
    received.raise_floor(4)
    received.raise_floor(2)
    assert [number in received for number in range(2, 7)] == [True, True, False, True, False]
