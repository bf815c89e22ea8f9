"""The window of a link: what makes it grow, what makes it shrink, and the capacity that it shows."""

import pytest

from swarmware.transport.retransmission.rate_control import (
    BASE_NS,
    FALL_NS,
    LOSS_PACKETS,
    PACKET_BYTES,
    SAMPLES_MIN,
    WINDOW_FIRST,
    WINDOW_MIN,
    RateControl,
)

MS = 1_000_000
RTT = 5 * MS
TARGET_NS = FALL_NS - RTT
"""Queue that the window fills at this round trip."""


class Rounds:
    """A window that is used to the full, round by round."""

    def __init__(self, loss: float = 0.0) -> None:
        self.now_ns = 10**9
        self.rate = RateControl(self.now_ns, loss)

    def round(
        self, rtt_ns: int, *, lost: int = 0, late: int = 0, arrived: int = 20, used: bool = True
    ) -> float:
        """One round trip; the window after it."""
        rate = self.rate
        for _ in range(arrived + lost):
            rate.on_sent(PACKET_BYTES)
        self.now_ns += rtt_ns
        for number in range(arrived):
            if used:
                rate.on_limited()
            rate.on_acknowledged(PACKET_BYTES)
            if number < SAMPLES_MIN:
                rate.on_round_trip(rtt_ns, self.now_ns)
        for _ in range(lost):
            rate.on_lost(PACKET_BYTES)
        for _ in range(late):
            rate.on_spurious()
        for _ in range(4):
            rate.on_round_trip(rtt_ns, self.now_ns)
        rate.on_round(rtt_ns, self.now_ns)
        return rate.window


def test_the_window_doubles_until_there_is_a_queue() -> None:
    rounds = Rounds()
    assert rounds.round(RTT) == 2 * WINDOW_FIRST
    assert rounds.round(RTT) == 4 * WINDOW_FIRST
    before = rounds.rate.window
    assert before < rounds.round(RTT + TARGET_NS // 2) < 1.1 * before
    before = rounds.rate.window
    assert before < rounds.round(RTT) < 1.2 * before, "it does not begin to double again"


def test_window_that_is_not_used_does_not_grow() -> None:
    assert Rounds().round(RTT, used=False) == WINDOW_FIRST


def test_long_queue_shrinks_window_to_what_link_passes() -> None:
    rounds = Rounds()
    rounds.round(RTT)
    before = rounds.round(RTT)
    after = rounds.round(RTT + 4 * TARGET_NS)
    passed = 20 * PACKET_BYTES / (RTT + 4 * TARGET_NS)
    assert after == max(before / 2, passed * (RTT + TARGET_NS / 2))
    windows = [rounds.round(RTT + 4 * TARGET_NS, arrived=4) for _ in range(5)]
    assert windows == sorted(windows, reverse=True)
    assert windows[-1] == WINDOW_MIN


def test_permanently_slower_link_gets_new_minimum() -> None:
    rounds = Rounds()
    rounds.round(RTT)
    for _ in range(30):
        rounds.round(10 * RTT, arrived=4)
    assert rounds.rate.delay.minimum_ns == 10 * RTT
    assert rounds.rate.window > WINDOW_MIN


def test_usual_loss_of_link_does_not_shrink_window() -> None:
    rounds = Rounds(loss=0.3)
    before = rounds.rate.window
    for _ in range(10):
        rounds.round(RTT, arrived=70, lost=30)
    assert rounds.rate.window > before


def test_loss_beyond_the_usual_one_does() -> None:
    rounds = Rounds()
    before = rounds.round(RTT)
    assert rounds.round(RTT, arrived=LOSS_PACKETS, lost=LOSS_PACKETS // 2) == 0.8 * before
    rounds = Rounds()
    before = rounds.round(RTT)
    rounds.rate.on_link_loss(0.35)
    assert rounds.round(RTT, arrived=LOSS_PACKETS, lost=LOSS_PACKETS // 2) > before


def test_a_late_packet_is_no_loss() -> None:
    rounds = Rounds()
    before = rounds.round(RTT)
    assert rounds.round(RTT, arrived=LOSS_PACKETS, lost=LOSS_PACKETS // 2, late=LOSS_PACKETS // 2) > before


def test_commands_have_a_reserve() -> None:
    rate = RateControl(0)
    rate.on_sent(WINDOW_FIRST)
    assert not rate.has_room(reserve=False)
    assert rate.has_room(reserve=True)
    rate.on_sent(2 * WINDOW_FIRST)
    assert not rate.has_room(reserve=True)


def test_pace_spreads_window_over_round_trip() -> None:
    rate = RateControl(0)
    now_ns, sent = 0, 0
    while now_ns < RTT:
        wait_ns = rate.wait_ns(RTT, now_ns)
        if wait_ns:
            now_ns += wait_ns
        else:
            rate.on_sent(PACKET_BYTES)
            sent += 1
    assert 12 <= sent <= 18


def test_minimum_of_round_trip_is_forgotten_after_while() -> None:
    rate = RateControl(0)
    rate.on_round_trip(RTT, 0)
    rate.on_round_trip(3 * RTT, BASE_NS)
    assert rate.delay.minimum_ns == RTT
    rate.on_round_trip(3 * RTT, 2 * BASE_NS)
    assert rate.delay.minimum_ns == 3 * RTT


def test_silence_halves_the_window() -> None:
    rate = RateControl(0)
    rate.on_silence()
    assert rate.window == WINDOW_FIRST / 2
    for _ in range(9):
        rate.on_silence()
    assert rate.window == WINDOW_MIN


def test_round_trip_from_beacons_shows_queue_at_once() -> None:
    rate = RateControl(0, base_ns=RTT)
    rate.on_round_trip(5 * RTT, 0)
    assert rate.delay.queueing_ns == 4 * RTT
    assert RateControl(0).delay.queueing_ns == 0


def test_capacity_is_what_arrives_while_link_is_limit() -> None:
    rounds = Rounds()
    rounds.round(RTT)
    rounds.round(RTT)
    assert rounds.rate.capacity_bytes_s is None, "an empty queue says that it carries more"
    busy = RTT + TARGET_NS // 2
    rounds.round(busy)
    assert rounds.rate.capacity_bytes_s == pytest.approx(20 * PACKET_BYTES * 1e9 / busy)
    for _ in range(300):
        rounds.round(busy, arrived=10, lost=10)
    assert rounds.rate.capacity_bytes_s == pytest.approx(10 * PACKET_BYTES * 1e9 / busy, rel=0.1)
    measured_ns = rounds.now_ns
    rounds.round(busy, used=False)
    rounds.round(RTT)
    assert rounds.rate.capacity_ns == measured_ns, "the sender had no more to send, or there is no queue"


def test_a_break_is_no_slow_link() -> None:
    rounds = Rounds()
    rounds.round(RTT)
    rounds.now_ns += 100 * RTT
    rounds.round(RTT + TARGET_NS)
    assert rounds.rate.capacity_bytes_s is None
