"""Timing of a recording: exact on average, however the calls come."""

import random

from hypothesis import given
from hypothesis import strategies as st

from swarmd.hal.core.packet_clock import PacketClock

S = 1_000_000_000


def test_ten_minutes_hold_exact_number_of_packets() -> None:
    clock = PacketClock(753.0, 1000, 0, loop=True)
    chance = random.Random(1)
    now_ns, count = 0, 0
    while now_ns < 600 * S:
        now_ns = min(600 * S, now_ns + chance.randrange(1, 30_000_000))
        count += len(list(clock.due(now_ns)))
    assert count == 753 * 600 + 1  # the first is due at once
    assert clock.lost == 0


@given(st.floats(0.5, 5000), st.lists(st.integers(1, 900_000_000), max_size=30))
def test_stamps_lie_on_rate_grid_before_now(rate: float, steps: list[int]) -> None:
    clock = PacketClock(rate, 7, 5, loop=True)
    now_ns, k = 5, 0
    for step in steps:
        now_ns += step
        for packet in clock.due(now_ns):
            assert packet.index == (k + clock.lost) % 7
            assert packet.stamp_ns <= now_ns
            assert abs(packet.stamp_ns - 5 - (k + clock.lost) * S / rate) < 1 + (k + clock.lost) * 1e3 / rate
            k += 1


def test_a_recording_that_does_not_loop_ends() -> None:
    clock = PacketClock(100.0, 5, 0, loop=False)
    assert [p.index for p in clock.due(S // 2)] == [0, 1, 2, 3, 4]
    assert list(clock.due(2 * S)) == []


def test_a_looped_one_begins_again() -> None:
    clock = PacketClock(8.0, 3, 0, loop=True)
    assert [p.index for p in clock.due(S // 2)] == [0, 1, 2, 0, 1]


def test_clock_continues_with_device_after_stall() -> None:
    clock = PacketClock(100.0, 1000, 0, loop=True)
    list(clock.due(0))
    packets = list(clock.due(10 * S))
    assert len(packets) == 100
    assert packets[-1].stamp_ns == 10 * S
    assert clock.lost == 900


def test_slow_recording_is_never_skipped_by_regular_call() -> None:
    clock = PacketClock(0.5, 3, 0, loop=True)
    assert [p.index for t in range(7) for p in clock.due(t * S)] == [0, 1, 2, 0]
