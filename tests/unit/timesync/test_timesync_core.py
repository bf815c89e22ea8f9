"""Time core: functions and events from exchanges."""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.timesync.config import Config
from swarmd.timesync.core.peer import TOGETHER_NS, Exchange
from swarmd.timesync.core.time_core import (
    Action,
    ClockStepped,
    FunctionsRefused,
    PeerExchange,
    Publish,
    TimeCore,
    UnitRebooted,
)
from swarmware.runtime.core import AT_ONCE
from swarmware.types import registry
from swarmware.types.time import Conversion, TimeFunctions

SECOND = 1_000_000_000
DELAY = 100_000


def core(**changes: float) -> TimeCore:
    return TimeCore("uav1", "main", 1, 10, Config(**changes), first_epoch=40)  # type: ignore[arg-type]


def heard(at_ns: int, offset_ns: int = 0, *, of: int = 2, boot_id: int = 5) -> PeerExchange:
    exchange = Exchange(at_ns, offset_ns - DELAY, at_ns - 50_000_000, offset_ns + DELAY)
    return PeerExchange(f"uav{of}", "main", of, boot_id, exchange)


def run(timer: TimeCore, *stream: PeerExchange) -> list[Action]:
    actions: list[Action] = []
    for one in stream:
        actions += timer.on_exchange(one, one.exchange.received_ns)
        actions += timer.on_timer(one.exchange.received_ns)
    return actions


def test_the_first_exchange_already_gives_a_function() -> None:
    actions = run(core(), heard(SECOND, 7_000))
    assert [type(action) for action in actions] == [Publish]
    published = actions[0]
    assert isinstance(published, Publish)
    function = published.functions.of("uav2")
    assert function is not None
    assert abs(function.to_remote(SECOND) - SECOND - 7_000) < 20_000


def test_without_an_echo_there_is_no_function() -> None:
    timer = core()
    timer.on_exchange(PeerExchange("uav2", "main", 2, 5, Exchange(SECOND, -DELAY)), SECOND)
    assert timer.on_timer(SECOND) == []
    assert timer.functions(SECOND).functions == ()


def test_publishing_is_paced_and_silence_needs_no_timer() -> None:
    timer = core()
    published = [
        action
        for tick in range(50)
        for action in run(timer, heard(SECOND + tick * SECOND // 10))
        if isinstance(action, Publish)
    ]
    assert 5 <= len(published) <= 7
    deadline_ns = timer.deadline_ns()
    assert deadline_ns is not None
    timer.on_timer(deadline_ns + SECOND)
    assert timer.deadline_ns() is None


def test_settled_functions_are_solved_with_periodic_work() -> None:
    timer, peers = core(publish_s=0.1), range(2, 12)
    solved: list[int] = []
    for tick in range(1200):
        now_ns = SECOND + tick * SECOND // 20 + 7_000_001
        timer.on_exchange(heard(now_ns, of=peers[tick % len(peers)]), now_ns)
        due_ns = timer.deadline_ns()
        assert due_ns is not None
        if due_ns <= now_ns + SECOND // 20:
            timer.on_timer(max(due_ns, now_ns))
            if tick > 600 and due_ns > now_ns:
                solved.append(due_ns)
    instants = [due_ns for due_ns in solved if due_ns % TOGETHER_NS == 0]
    assert len(instants) >= 0.7 * len(solved), "the rest publishes what was solved"
    assert instants, "ten neighbours each three seconds, several at one instant"


def test_neighbours_are_solved_in_one_wake_up() -> None:
    timer, peers = core(), range(2, 17)
    wakes: list[int] = []
    published = 0
    for tick in range(2400):
        now_ns = SECOND + tick * SECOND // 20 + 7_000_001
        of = peers[tick % len(peers)]
        if tick > 21 * of:
            timer.on_exchange(heard(now_ns, of=of), now_ns)
        while (due_ns := timer.deadline_ns()) is not None and due_ns <= now_ns + SECOND // 20:
            actions = timer.on_timer(max(due_ns, now_ns) + 3_000_000)  # woken a little late
            if now_ns > 90 * SECOND:
                wakes.append(due_ns)
                published += sum(isinstance(action, Publish) for action in actions)
    assert len(wakes) <= 31 / 3 + 1, "each wake-up solves all fifteen, and publishes them once"
    assert all(due_ns % (3 * SECOND) == 0 for due_ns in wakes)
    assert published == len(wakes)


def test_functions_for_measured_units_are_not_composed(monkeypatch: pytest.MonkeyPatch) -> None:
    timer = core()
    for tick in range(40):
        at_ns = SECOND + tick * SECOND // 10
        run(timer, heard(at_ns, of=2), heard(at_ns, of=3))
    now_ns = 5 * SECOND + 1
    stated = tuple(
        Conversion(f"uav{of}", "main", of, 5, 0, 0.0, now_ns, 1000, 100, 1e-6, 0, samples=50) for of in (3, 4)
    )
    timer.on_functions(TimeFunctions("uav2", "main", 5, now_ns, stated), now_ns)
    composed: list[str] = []
    before = Conversion.then

    def then(link: Conversion, further: Conversion, via: str) -> Conversion:
        composed.append(further.platform)
        return before(link, further, via)

    monkeypatch.setattr(Conversion, "then", then)
    assert {each.platform for each in timer.functions(now_ns).functions} == {"uav2", "uav3", "uav4"}
    assert composed == ["uav4"]


def test_three_impossible_packets_in_row_are_step() -> None:
    timer = core()
    run(timer, *(heard(SECOND + tick * SECOND // 10) for tick in range(100)))
    later = 12 * SECOND
    jump = 5 * SECOND
    steps = [
        a for a in run(timer, *(heard(later + n, jump) for n in (10, 11, 12))) if isinstance(a, ClockStepped)
    ]
    assert steps == [ClockStepped("uav2", "main", 41)]
    run(timer, heard(later + SECOND, jump))
    function = timer.functions(later + SECOND).of("uav2")
    assert function is not None
    assert function.conv_epoch == 41
    assert abs(function.to_remote(later) - later - jump) < 1_000_000


def test_two_outliers_change_nothing() -> None:
    timer = core()
    run(timer, *(heard(SECOND + tick * SECOND // 10) for tick in range(100)))
    at_ns = 12 * SECOND
    actions = run(timer, heard(at_ns, 5 * SECOND), heard(at_ns + 1, 5 * SECOND), heard(at_ns + 2))
    assert not [action for action in actions if isinstance(action, ClockStepped)]


def test_another_boot_is_another_clock() -> None:
    timer = core()
    run(timer, heard(SECOND, 0, boot_id=5))
    actions = run(timer, heard(2 * SECOND, 9 * SECOND, boot_id=6))
    assert actions[0] == UnitRebooted("uav2", "main")
    assert run(timer, heard(2 * SECOND, 0, boot_id=5)) == []
    function = timer.functions(2 * SECOND).of("uav2")
    assert function is not None
    assert function.boot_id == 6


def told(by: int, *functions: Conversion, boot_id: int = 5) -> TimeFunctions:
    return TimeFunctions(f"uav{by}", "main", boot_id, SECOND, functions)


def function(of: int, *, boot_id: int = 5, hops: int = 1, via: str = "") -> Conversion:
    return Conversion(
        f"uav{of}", "main", of, boot_id, 3_000, 0.0, SECOND, 50_000, 1_000, 0.0, 0, hops, via, samples=9
    )


def test_neighbour_gives_way_to_unit_never_met() -> None:
    timer = core()
    run(timer, heard(SECOND))
    timer.on_functions(told(2, function(9)), SECOND)
    far = timer.functions(SECOND).of("uav9")
    assert far is not None
    assert (far.hops, far.via) == (2, "uav2")


def test_news_known_through_us_is_ignored() -> None:
    timer = core()
    run(timer, heard(SECOND))
    timer.on_functions(told(2, function(9, via="uav1", hops=3), function(1, boot_id=10)), SECOND)
    assert [known.platform for known in timer.functions(SECOND).functions] == ["uav2"]


def test_measured_function_is_preferred_to_composed_one() -> None:
    timer = core()
    run(timer, heard(SECOND), heard(SECOND, of=9))
    timer.on_functions(told(2, function(9)), SECOND)
    near = timer.functions(SECOND).of("uav9")
    assert near is not None
    assert near.hops == 1


def test_partner_statement_does_not_outlast_packets() -> None:
    timer = core()
    wide = Exchange(SECOND, -9 * DELAY, SECOND - 50_000_000, 9 * DELAY)
    run(timer, heard(SECOND), PeerExchange("uav9", "main", 9, 5, wide))
    timer.on_functions(told(2, msgspec.structs.replace(function(9), bound_ns=1)), SECOND)
    near = timer.functions(SECOND).of("uav9")
    assert near is not None
    assert near.hops == 1, "though the partner states a smaller bound"
    later = timer.functions(SECOND + 11 * SECOND).of("uav9")
    assert later is not None
    assert later.hops == 2, "nothing has come from it for long"


def test_partner_gives_first_value_before_any_echo() -> None:
    timer = core()
    timer.on_exchange(PeerExchange("uav2", "main", 2, 5, Exchange(SECOND, -DELAY)), SECOND)
    timer.on_timer(SECOND)
    timer.on_functions(told(2, function(1, boot_id=10)), SECOND)
    first = timer.functions(SECOND).of("uav2")
    assert first is not None
    assert first.samples == 0
    assert first.offset_ns == -3_000


def test_words_of_earlier_boot_of_partner_are_ignored() -> None:
    timer = core()
    run(timer, heard(SECOND))
    timer.on_functions(told(2, function(9), boot_id=4), SECOND)
    assert timer.functions(SECOND).of("uav9") is None


def test_a_unit_not_heard_for_long_is_forgotten() -> None:
    timer = core(forget_s=100.0)
    run(timer, heard(SECOND))
    assert timer.functions(90 * SECOND).of("uav2") is not None
    assert timer.functions(102 * SECOND).of("uav2") is None


def test_list_is_bounded_and_keeps_best_known() -> None:
    timer = core(functions_limit=3)
    for of in range(2, 9):
        run(timer, heard(SECOND, of=of))
    assert len(timer.functions(SECOND).functions) == 3


def test_one_invalid_stamp_costs_history_without_step() -> None:
    timer = core()
    run(timer, *(heard(SECOND + tick * SECOND // 10, 5_000) for tick in range(20)))
    wrong = 3 * SECOND + 50_000_000
    # 150 µs more than possible: inside the margin of a step, outside the corridor
    actions = run(timer, heard(wrong, 5_000 + 2 * DELAY + 150_000))
    actions += run(timer, *(heard(wrong + tick * SECOND // 10, 5_000) for tick in range(1, 30)))
    assert not [action for action in actions if isinstance(action, ClockStepped)]
    function = timer.functions(6 * SECOND).of("uav2")
    assert function is not None
    assert function.conv_epoch == 40
    assert abs(function.offset_ns - 5_000) < 20_000


def test_small_unfittable_step_is_step() -> None:
    timer = core()
    run(timer, *(heard(SECOND + tick * SECOND // 10) for tick in range(200)))
    jump = 2 * DELAY + 100_000
    after = [heard(22 * SECOND + tick * SECOND // 10, jump) for tick in range(40)]
    steps = [action for action in run(timer, *after) if isinstance(action, ClockStepped)]
    assert len(steps) == 1
    function = timer.functions(26 * SECOND).of("uav2")
    assert function is not None
    assert abs(function.to_remote(26 * SECOND) - 26 * SECOND - jump) < 50_000


@pytest.mark.parametrize(
    "wrong",
    [
        {"skew": math.nan},
        {"skew": math.inf},
        {"skew": -math.inf},
        {"skew": 0.5},
        {"skew": -1.0},
        {"skew_bound": math.nan},
        {"skew_bound": -1e-6},
        {"skew_bound": 1e300},
        {"offset_ns": 1 << 63},
        {"t0_ns": -(1 << 63)},
        {"bound_ns": -1},
        {"bound_ns": (1 << 64) - 1},
        {"sigma_ns": 1 << 63},
        {"hops": 0},
        {"hops": -3},
        {"hops": 10_000},
        {"hardware": -1},
        {"platform": "no name\n"},
        {"via": "../.."},
    ],
    ids=str,
)
def test_impossible_function_is_refused_others_used(
    wrong: dict[str, Any],
) -> None:
    timer = core()
    run(timer, heard(SECOND))
    timer.on_exchange(PeerExchange("uav3", "main", 3, 5, Exchange(SECOND, -DELAY)), SECOND)
    bad = msgspec.structs.replace(function(8), **wrong)
    assert timer.on_functions(told(2, bad, function(9)), SECOND) == [FunctionsRefused("uav2", 1, 2)]
    assert timer.on_functions(told(2, bad, function(9)), SECOND) == [], "it is said once"
    # as a first value of our own clock, and as the way to another
    of_us = msgspec.structs.replace(function(1, boot_id=10), **wrong)
    assert timer.on_functions(told(3, of_us), SECOND) == [FunctionsRefused("uav3", 1, 1)]
    timer.on_timer(2 * SECOND)
    known = timer.functions(2 * SECOND)
    assert {one.platform for one in known.functions} == {"uav2", "uav9"}
    assert registry.decode(TimeFunctions, registry.encode(known)) == known


_number = st.one_of(
    st.integers(-(1 << 63), (1 << 64) - 1), st.sampled_from([0, 1, -1, SECOND, (1 << 61) - 1, -(1 << 61)])
)
_ratio = st.one_of(st.floats(), st.floats(-1e-3, 1e-3))


@given(
    st.lists(
        st.builds(
            Conversion,
            platform=st.sampled_from(["uav1", "uav2", "uav9", ""]),
            unit=st.just("main"),
            hardware=st.one_of(st.sampled_from([1, 2, 9]), _number),
            boot_id=st.one_of(st.sampled_from([5, 10]), _number),
            offset_ns=_number,
            skew=_ratio,
            t0_ns=_number,
            bound_ns=_number,
            sigma_ns=_number,
            skew_bound=_ratio,
            conv_epoch=_number,
            hops=st.one_of(st.integers(1, 24), _number),
            via=st.sampled_from(["", "uav1", "uav4"]),
            samples=_number,
            rtt_ns=_number,
        ),
        max_size=6,
    ),
    st.sampled_from([0, SECOND, 1 << 62]),
)
def test_any_statement_gives_finite_published_list(functions: list[Conversion], now_ns: int) -> None:
    timer = core()
    run(timer, heard(SECOND, of=2))
    timer.on_exchange(PeerExchange("uav3", "main", 3, 5, Exchange(SECOND, -DELAY)), SECOND)
    for by in (2, 3):
        timer.on_functions(told(by, *functions), now_ns)
    timer.on_timer(now_ns)
    for one in timer.functions(now_ns).functions:
        assert one.bound_at_ns(now_ns) >= 0
        assert one.to_local(one.to_remote(now_ns)) is not None
    known = timer.functions(now_ns)
    assert registry.decode(TimeFunctions, registry.encode(known)) == known


def test_neighbour_without_echo_has_no_function() -> None:
    timer = core()
    timer.on_exchange(PeerExchange("uav2", "main", 2, 5, Exchange(SECOND, -DELAY)), SECOND)
    timer.on_timer(SECOND)
    assert timer.unmeasured() == {"uav2"}
    run(timer, heard(2 * SECOND))
    assert timer.unmeasured() == set()


def test_rate_change_during_silence_is_no_step() -> None:
    timer = core()
    drift = 5e-6
    run(timer, *(heard(SECOND + tick * SECOND // 10) for tick in range(300)))
    silence = 600 * SECOND
    back = [
        heard(31 * SECOND + silence + tick * SECOND // 10, round(drift * (silence + tick * SECOND // 10)))
        for tick in range(50)
    ]
    assert not [action for action in run(timer, *back) if isinstance(action, ClockStepped)]
    at_ns = back[-1].exchange.received_ns
    known = timer.functions(at_ns).of("uav2")
    assert known is not None
    assert abs(known.to_remote(at_ns) - at_ns - round(drift * (silence + 5 * SECOND))) < 100_000


def test_newer_of_contradicting_functions_is_taken() -> None:
    timer = core()
    for at_ns in (SECOND, 20 * SECOND):
        run(timer, *(heard(at_ns + n * SECOND // 10, of=of) for n in range(9) for of in (2, 3)))
    timer.on_functions(told(2, function(9)), 2 * SECOND)
    stepped = msgspec.structs.replace(
        function(9), offset_ns=20_000_000, t0_ns=20 * SECOND, bound_ns=2_000_000, conv_epoch=1
    )
    timer.on_functions(told(3, stepped), 21 * SECOND)
    found = timer.functions(21 * SECOND).of("uav9")
    assert found is not None
    assert found.via == "uav3"
    assert abs(found.offset_ns - 20_000_000) < 1_000_000


def test_partners_first_value_is_renewed_until_measured() -> None:
    timer = core()
    for offset_ns, at_s in ((3_000, 1), (9_000_000, 30)):
        timer.on_exchange(PeerExchange("uav2", "main", 2, 5, Exchange(at_s * SECOND, -DELAY)), at_s * SECOND)
        of_us = msgspec.structs.replace(
            function(1, boot_id=10), platform="uav1", offset_ns=-offset_ns, t0_ns=at_s * SECOND
        )
        timer.on_functions(told(2, of_us), at_s * SECOND)
        assert timer.stated() == {"uav2"}
        found = timer.functions(at_s * SECOND).of("uav2")
        assert found is not None
        assert found.offset_ns == offset_ns


def test_partner_statement_ends_unless_repeated() -> None:
    timer = core()
    run(timer, heard(SECOND), heard(2 * SECOND))
    timer.on_functions(told(2, function(9)), 2 * SECOND)
    assert timer.functions(3 * SECOND).of("uav9") is not None
    deadline_ns = timer.deadline_ns()
    while deadline_ns is not None:
        (published,) = [one for one in timer.on_timer(deadline_ns) if isinstance(one, Publish)] or (None,)
        at_ns, deadline_ns = deadline_ns, timer.deadline_ns()
    assert at_ns < 65 * SECOND
    assert published is not None
    assert published.functions.of("uav9") is None


def test_step_and_first_statement_are_published_next() -> None:
    timer = core()
    run(timer, *(heard(SECOND + tick * SECOND // 10) for tick in range(100)))
    jumped = [heard(12 * SECOND + n, 5 * SECOND) for n in range(3)]
    assert any(
        isinstance(action, ClockStepped)
        for one in jumped
        for action in timer.on_exchange(one, one.exchange.received_ns)
    )
    assert timer.deadline_ns() == AT_ONCE
    other = core()
    other.on_exchange(PeerExchange("uav2", "main", 2, 5, Exchange(SECOND, -DELAY)), SECOND)
    other.on_functions(told(2, function(1, boot_id=10)), SECOND)
    assert other.deadline_ns() == AT_ONCE
    assert [type(action) for action in other.on_timer(SECOND)] == [Publish]
    assert other.deadline_ns() != AT_ONCE
