"""Life of a fault: pending, confirmed, healed, cleared."""

from hypothesis import given
from hypothesis import strategies as st

from swarmd.health.core.faults import HISTORY, CheckSample, FaultTable
from swarmware.types.health import Fault, Phase

SECOND = 1_000_000_000
LOW = CheckSample("battery", "low", "warn", freeze_frame="0.29")


def test_single_bad_check_is_pending_unreported() -> None:
    book = FaultTable(5)
    assert book.on_failed(LOW, 0, confirmed=False) is None
    assert [fault.phase for fault in book.open()] == [Phase.PENDING]
    assert book.confirmed() == []
    assert book.on_passed("battery", 1) is None
    assert book.open() == ()
    assert book.cleared() == ()


def test_fault_life_has_times_and_freeze_frame() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 1 * SECOND, confirmed=False)
    told = book.on_failed(
        CheckSample("battery", "low", "warn", freeze_frame="0.28"), 2 * SECOND, confirmed=True
    )
    assert told == Fault("battery", "low", "warn", Phase.CONFIRMED, 1 * SECOND, 2 * SECOND, 1, "0.28")
    assert book.on_failed(LOW, 3 * SECOND, confirmed=True) is None
    healed = book.on_passed("battery", 4 * SECOND)
    assert healed is not None
    assert (healed.phase, healed.last_ns) == (Phase.HEALED, 3 * SECOND)
    assert book.advance(9 * SECOND - 1) == []
    assert [fault.phase for fault in book.advance(9 * SECOND)] == [Phase.CLEARED]
    assert book.open() == ()
    assert [fault.check for fault in book.cleared()] == ["battery"]


def test_fault_returning_before_clear_is_counted() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 0, confirmed=True)
    book.on_passed("battery", 1 * SECOND)
    again = book.on_failed(LOW, 2 * SECOND, confirmed=True)
    assert again is not None
    assert (again.phase, again.count, again.first_ns) == (Phase.CONFIRMED, 2, 0)
    assert book.advance(60 * SECOND) == []


def test_one_that_gets_worse_is_told_again() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 0, confirmed=True)
    worse = book.on_failed(CheckSample("battery", "critical", "error"), 1, confirmed=True)
    assert worse is not None
    assert (worse.state, worse.level, worse.count) == ("critical", "error", 1)


def test_a_check_that_is_withdrawn_leaves_no_fault() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 0, confirmed=True)
    gone = book.withdraw("battery", 1)
    assert gone is not None
    assert gone.phase is Phase.CLEARED
    assert book.open() == ()


def test_the_worst_comes_first() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 0, confirmed=True)
    book.on_failed(CheckSample("motor", "hot", "error"), 1, confirmed=True)
    assert [fault.check for fault in book.confirmed()] == ["motor", "battery"]


def test_faults_survive_the_monitor() -> None:
    book = FaultTable(5)
    book.on_failed(LOW, 0, confirmed=True)
    book.on_failed(CheckSample("motor", "hot", "error"), 1, confirmed=True)
    book.on_passed("motor", 2)
    heir = FaultTable(5)
    heir.restore(book.open(), 3)
    assert heir.open() == book.open()
    assert [fault.check for fault in heir.advance(3 + 5 * SECOND)] == ["motor"]


@given(st.lists(st.tuples(st.sampled_from(["bad", "seen", "good", "time", "forget"]), st.integers(0, 9))))
def test_the_history_is_bounded_and_counts_never_fall(events: list[tuple[str, int]]) -> None:
    book = FaultTable(5)
    now_ns = 0
    counts: dict[str, int] = {}
    for what, value in events:
        now_ns += value * SECOND
        check = f"c{value % 3}"
        match what:
            case "bad" | "seen":
                book.on_failed(CheckSample(check, "low", "warn"), now_ns, confirmed=what == "bad")
            case "good":
                book.on_passed(check, now_ns)
            case "time":
                book.advance(now_ns)
            case _:
                book.withdraw(check, now_ns)
        for fault in book.open():
            assert fault.first_ns <= fault.last_ns <= now_ns
            assert (fault.phase is Phase.PENDING) == (fault.count == 0)
        present = {fault.check: fault.count for fault in book.open()}
        for name, count in present.items():
            assert count >= counts.get(name, 0)
        counts = present
    assert len(book.cleared()) <= HISTORY
