"""When datagrams leave: spread, soon when it matters, never more than the air carries."""

import math
from itertools import pairwise

import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.beacon.beacon import PlatformCode
from swarmd.broker.core.beacon.beacon_rate import (
    AIRTIME,
    CHANGING_HZ,
    EVALUATED_MIN,
    EVALUATION_NS,
    IDLE_HZ,
    JITTER,
    QUIET_HELLOS,
    SLOWDOWN_MAX,
    STEP_MAX,
    STEP_MIN,
    TRIGGERED_NS,
    BeaconSchedule,
    QuietRate,
    Slowdown,
    airtime_s,
    allowed_hz,
)
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon_protocol import BeaconProtocol
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import Counters

SECOND = 1_000_000_000
MS = SECOND // 1000
PERIOD = SECOND // 10


@pytest.mark.parametrize(("chance", "spread"), [(0.0, 1 - JITTER), (0.5, 1.0), (1.0, 1 + JITTER)])
def test_beacons_are_spread_by_chance(chance: float, spread: float) -> None:
    schedule = BeaconSchedule(0, lambda: chance)
    schedule.set_next(0, PERIOD)
    assert schedule.due_ns == round(PERIOD * spread)


def test_late_beacon_does_not_make_next_ones_early() -> None:
    schedule = BeaconSchedule(0, lambda: 0.5)
    schedule.set_next(10 * SECOND, PERIOD)
    assert schedule.due_ns == 10 * SECOND


def test_what_cannot_wait_leaves_soon() -> None:
    schedule = BeaconSchedule(0, lambda: 1.0)
    schedule.on_sent(0)
    schedule.set_next(0, SECOND)
    assert schedule.trigger(PERIOD, 1_000_000)
    assert schedule.due_ns == PERIOD + TRIGGERED_NS
    assert schedule.urgent
    assert not schedule.trigger(PERIOD + 1, 1_000_000), "it is due earlier already"


def test_idle_node_checks_periodically_and_sends_at_random() -> None:
    chances = iter([0.5, 0.9, 0.5, 0.1, 0.5, 0.7] * 10)
    schedule = BeaconSchedule(3 * MS, lambda: next(chances))
    looks, sent = [], []
    for _ in range(60):
        now_ns = schedule.due_ns + MS  # as late as an event loop wakes
        idle = now_ns // PERIOD % 5 != 0  # as a parked vehicle: something to say each half second
        if not schedule.urgent and idle:
            looks.append(now_ns)
            schedule.skip(now_ns, PERIOD)
        elif schedule.urgent or not schedule.defer_after_skip(now_ns, PERIOD):
            sent.append(now_ns)
            schedule.on_sent(now_ns)
            schedule.set_next(now_ns, PERIOD)
    assert [now_ns for now_ns in looks[1:] if now_ns % PERIOD != MS] == []
    spread = [now_ns % (5 * PERIOD) for now_ns in sent[1:]]
    assert len(set(spread)) >= 3, "by chance, or nodes that look at the same instants would collide"
    assert all(0 <= one_ns <= schedule.jitter_ns(PERIOD) + 2 * MS for one_ns in spread)
    assert {(after - before) // PERIOD for before, after in pairwise(sent[1:])} <= {4, 5}


def test_node_with_news_is_spread_after_one_beacon() -> None:
    schedule = BeaconSchedule(0, lambda: 0.8)
    schedule.skip(0, PERIOD)
    sent: list[int] = []
    while len(sent) < 4:
        now_ns = schedule.due_ns
        if schedule.urgent or not schedule.defer_after_skip(now_ns, PERIOD):
            sent.append(now_ns)
            schedule.on_sent(now_ns)
            schedule.set_next(now_ns, PERIOD)
    gaps = [after - before for before, after in pairwise(sent)]
    assert all(gap_ns >= PERIOD * (1 - JITTER) for gap_ns in gaps)
    assert gaps[-1] == round(PERIOD * (1 + 0.6 * JITTER))


def test_events_never_exceed_rate_of_air() -> None:
    schedule = BeaconSchedule(0, lambda: 0.0)
    gap_ns = round(1e9 / allowed_hz(299, 600))
    period_ns = 2 * gap_ns
    sent = 0
    for now_ns in range(0, 60 * SECOND, SECOND // 100):
        schedule.trigger(now_ns, gap_ns)
        if now_ns >= schedule.due_ns:
            schedule.on_sent(now_ns)
            schedule.set_next(now_ns, period_ns)
            sent += 1
    assert 300 * sent * airtime_s(600) / 60 <= AIRTIME * 1.05


@pytest.mark.parametrize("heard", [199, 299, 499])
def test_the_rate_falls_below_one_hertz_among_hundreds(heard: int) -> None:
    assert 0.2 < allowed_hz(heard, 1100) < 1.0
    assert (heard + 1) * allowed_hz(heard, 1100) * airtime_s(1100) <= 0.25


def judge(slowdown: Slowdown, late_ms: float, period_ms: float, times: int = 1) -> float:
    """A number of complete judgements of beacons, each with this lateness."""
    for _ in range(times * max(EVALUATED_MIN, math.ceil(EVALUATION_NS / MS / period_ms))):
        slowdown.on_beacon(round(late_ms * MS), round(period_ms * MS))
    return slowdown.factor


@pytest.mark.parametrize(
    ("late_ms", "period_ms", "factor"),
    [
        (0, 100, 1.0),
        (20, 100, 1.0),
        (21, 100, STEP_MIN),
        (30, 100, 1.5),
        (90, 100, STEP_MAX),
        (99, 500, 1.0),
        (150, 500, 1.5),
    ],
)
def test_late_beacons_slow_down_by_their_lateness(late_ms: float, period_ms: float, factor: float) -> None:
    assert judge(Slowdown(), late_ms, period_ms) == pytest.approx(factor)


def test_single_stalls_slow_nothing_down() -> None:
    slowdown = Slowdown()
    for slot in range(90):
        assert not slowdown.on_beacon((400 if slot % 3 == 0 else 1) * MS, PERIOD)
    assert (slowdown.factor, slowdown.delayed_beacons) == (1.0, 0)


def test_overloaded_processor_slows_beacons_and_counts_them() -> None:
    slowdown = Slowdown()
    assert judge(slowdown, 90, 100, times=9) == SLOWDOWN_MAX
    assert slowdown.delayed_beacons == 8 * 9
    assert slowdown.late_ns == 90 * MS


def test_very_late_node_slows_after_three_beacons() -> None:
    slowdown = Slowdown()
    for late_ms in (0, 400, 101, 900):
        assert slowdown.factor == 1.0
        slowdown.on_beacon(late_ms * MS, PERIOD)
    assert slowdown.factor == STEP_MAX
    assert slowdown.late_ns == 400 * MS


def test_slowed_rate_returns_in_steps_when_calm() -> None:
    slowdown = Slowdown()
    judge(slowdown, 40, 100)
    assert slowdown.factor == 2.0
    assert judge(slowdown, 17, 200, times=20) == 2.0, "neither short nor calm: it stays"
    assert judge(slowdown, 14, 200) == 2.0, "not calm for long enough"
    assert judge(slowdown, 14, 200) == pytest.approx(1.4), "where 14 ms will be a tenth of the period"
    assert judge(slowdown, 5, 140, times=20) == 1.0
    assert not slowdown.on_beacon(0, PERIOD)


def test_most_slowed_node_recovers_within_ten_seconds() -> None:
    slowdown = Slowdown()
    judge(slowdown, 300, 100)
    judge(slowdown, 300, 400)
    judge(slowdown, 300, 1000)
    assert slowdown.factor == SLOWDOWN_MAX
    now_ns = 0
    while slowdown.factor > 1:
        period_ns = round(PERIOD * slowdown.factor)
        slowdown.on_beacon(MS, period_ns)
        now_ns += period_ns
    assert now_ns < 12 * SECOND


def test_node_short_at_full_rate_does_not_swing() -> None:
    """Beacons begin late while the period is below twice the wanted one."""
    slowdown = Slowdown()
    short = 0
    for _ in range(3000):
        late_ns = 50 * MS if slowdown.factor < 2 else 2 * MS
        short += slowdown.on_beacon(late_ns, round(PERIOD * slowdown.factor)) and late_ns > 2 * MS
    assert short <= 3000 / 20


def test_a_stretched_period_is_declared_before_links_fall() -> None:
    identity = NodeIdentity(1, "uav1", "main", PlatformCode.UAV, 1, b"")
    protocol = BeaconProtocol(identity, Topology(1, 1, SECOND, 0), Counters(), Config(relay_bytes_s=0.0))
    protocol.advance(0)
    assert protocol.compose(0).beacon.hello is not None
    assert protocol.compose(PERIOD).beacon.hello is None
    judge(protocol.slowdown, 60, 500)
    assert protocol.beacon_hz() == IDLE_HZ
    judge(protocol.slowdown, 200, 500)
    assert protocol.beacon_hz() == IDLE_HZ / 2
    hello = protocol.compose(2 * PERIOD).beacon.hello
    assert hello is not None
    assert hello.period_ms == 1000
    judge(protocol.slowdown, 900, 1000, times=9)
    assert protocol.beacon_hz() == IDLE_HZ / SLOWDOWN_MAX


def test_rate_falls_after_declaring_longer_period() -> None:
    rate = QuietRate()
    assert rate.hz() == IDLE_HZ, "a node that was never faster has nothing to declare"
    rate.on_change()
    for _ in range(QUIET_HELLOS):
        assert rate.is_falling
        assert rate.hz() == CHANGING_HZ
        rate.on_hello()
    assert rate.hz() == IDLE_HZ
    rate.on_change()
    assert rate.hz() == CHANGING_HZ
