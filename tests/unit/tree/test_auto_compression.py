"""The compression `auto`: on while it pays, off where it saves too little or takes too much, tried again."""

from itertools import pairwise

import pytest

from swarmd.tree.core.notification.auto_compression import (
    CODED,
    CORE_MAX,
    PLAIN,
    REDUCTION_MIN,
    RETRY_NS,
    WINDOW_NS,
    AutoCompression,
    AutoState,
)

S = 1_000_000_000
MS = 1_000_000


def run(
    auto: AutoCompression, begin_s: float, end_s: float, saved: float, spent_ns: int, hz: int = 10
) -> float:
    """Values of 10 kB come; the share of them that was compressed."""
    count, coded, hz = 0, 0, 10
    for index in range(round((end_s - begin_s) * hz)):
        now_ns = round(begin_s * S) + index * S // hz
        count += 1
        if auto.compression(now_ns) == CODED:
            coded += 1
            auto.on_coded(10_000, round(10_000 * (1 - saved)), spent_ns, now_ns)
    return coded / count


def state_of(auto: AutoCompression) -> AutoState:
    return auto.state


@pytest.mark.parametrize(
    ("saved", "spent_ns", "state"),
    [
        (0.7, 1 * MS, AutoState.ON),
        (REDUCTION_MIN + 0.01, 1 * MS, AutoState.ON),
        (REDUCTION_MIN - 0.01, 1 * MS, AutoState.OFF),
        (0.7, round(0.9 * CORE_MAX * 100) * MS, AutoState.ON),
        (0.7, round(1.2 * CORE_MAX * 100) * MS, AutoState.OFF),
        (-0.01, 0, AutoState.OFF),
    ],
)
def test_it_is_on_where_it_saves_enough_for_its_processor_time(
    saved: float, spent_ns: int, state: AutoState
) -> None:
    auto = AutoCompression()
    run(auto, 0, 5, saved, spent_ns)
    assert auto.state is state
    assert auto.compression(5 * S) == (PLAIN if state is AutoState.OFF else CODED)


def test_it_is_tried_again_after_longer_and_longer_pauses() -> None:
    auto = AutoCompression()
    tried = []
    for second in range(900):
        before = auto.state
        run(auto, second, second + 1, 0.0, MS)
        if before is AutoState.OFF and state_of(auto) is AutoState.TRIAL:
            tried.append(second)
    pauses = [later - sooner for sooner, later in pairwise(tried)]
    assert pauses[:3] == [pytest.approx(ns / S + WINDOW_NS / S, abs=1) for ns in RETRY_NS[1:]]


def test_it_switches_itself_off_when_values_change_and_on_again_with_them() -> None:
    auto = AutoCompression()
    assert run(auto, 0, 20, 0.7, MS) == 1.0
    run(auto, 20, 30, 0.02, MS)
    assert state_of(auto) is AutoState.OFF
    run(auto, 30, 120, 0.7, MS)
    assert state_of(auto) is AutoState.ON
    assert run(auto, 120, 140, 0.7, MS) == 1.0


def test_one_slow_value_and_few_values_decide_nothing() -> None:
    auto = AutoCompression()
    auto.compression(0)
    auto.on_coded(10_000, 3000, 3 * S, S)
    auto.on_coded(10_000, 3000, MS, 10 * S)
    assert state_of(auto) is AutoState.TRIAL
    auto.on_coded(10_000, 3000, MS, 20 * S)
    assert state_of(auto) is AutoState.ON
