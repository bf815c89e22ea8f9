"""When datagrams leave: spread, soon when it matters, never more than the air carries."""

import pytest

from swarmd.broker.core.pace import AIRTIME, HURRY_NS, JITTER, Pace, airtime_s, allowed_hz

SECOND = 1_000_000_000
PERIOD = SECOND // 10


@pytest.mark.parametrize(("chance", "spread"), [(0.0, 1 - JITTER), (0.5, 1.0), (1.0, 1 + JITTER)])
def test_ticks_are_spread_by_chance(chance: float, spread: float) -> None:
    pace = Pace(0, lambda: chance)
    pace.next(0, PERIOD)
    assert pace.due_ns == round(PERIOD * spread)


def test_a_late_tick_does_not_make_the_next_ones_early() -> None:
    pace = Pace(0, lambda: 0.5)
    pace.next(10 * SECOND, PERIOD)
    assert pace.due_ns == 10 * SECOND


def test_what_cannot_wait_leaves_soon() -> None:
    pace = Pace(0, lambda: 1.0)
    pace.left(0)
    pace.next(0, SECOND)
    assert pace.hurry(PERIOD, 1_000_000)
    assert pace.due_ns == PERIOD + HURRY_NS
    assert pace.urgent
    assert not pace.hurry(PERIOD + 1, 1_000_000), "it is due earlier already"


def test_no_number_of_events_makes_a_node_send_more_than_the_air_allows() -> None:
    pace = Pace(0, lambda: 0.0)
    gap_ns = round(1e9 / allowed_hz(299, 600))
    period_ns = 2 * gap_ns
    sent = 0
    for now_ns in range(0, 60 * SECOND, SECOND // 100):
        pace.hurry(now_ns, gap_ns)
        if now_ns >= pace.due_ns:
            pace.left(now_ns)
            pace.next(now_ns, period_ns)
            sent += 1
    assert 300 * sent * airtime_s(600) / 60 <= AIRTIME * 1.05


@pytest.mark.parametrize("heard", [199, 299, 499])
def test_the_rate_falls_below_one_hertz_among_hundreds(heard: int) -> None:
    assert 0.2 < allowed_hz(heard, 1100) < 1.0
    assert (heard + 1) * allowed_hz(heard, 1100) * airtime_s(1100) <= 0.25
