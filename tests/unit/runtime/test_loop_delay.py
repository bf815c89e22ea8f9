"""The delay of a core by its event loop: what counts, once, and for how long it is remembered."""

import pytest

from swarmware.runtime.core import AT_ONCE
from swarmware.runtime.loop_delay import LATE_NS, MEMORY_NS, LoopDelay

S = 1_000_000_000


@pytest.mark.parametrize(
    ("due_ns", "now_ns", "late_ns"),
    [
        (None, 10 * S, 0),
        (AT_ONCE, 10 * S, 0),
        (10 * S, 9 * S, 0),
        (10 * S, 10 * S + LATE_NS, 0),
        (10 * S, 10 * S + LATE_NS + 1, LATE_NS + 1),
        (10 * S, 12 * S, 2 * S),
    ],
)
def test_only_long_passed_deadline_is_delay(due_ns: int | None, now_ns: int, late_ns: int) -> None:
    delay = LoopDelay()
    assert delay.on_turn(due_ns, now_ns) == late_ns
    assert delay.recent_ns(now_ns) == late_ns


def test_calls_of_one_late_turn_count_once() -> None:
    delay = LoopDelay()
    assert delay.on_turn(S, 3 * S) == 2 * S
    assert delay.on_turn(S, 3 * S + 1000) == 0
    assert delay.on_turn(S, 4 * S) == S, "the deadline was not met meanwhile either"
    assert delay.recent_ns(4 * S) == 2 * S


def test_the_longest_delay_is_remembered_for_some_seconds() -> None:
    delay = LoopDelay()
    delay.on_turn(S, 3 * S)
    delay.on_turn(4 * S, 4 * S + S // 2)
    assert delay.recent_ns(3 * S + MEMORY_NS - 1) == 2 * S
    assert delay.recent_ns(3 * S + MEMORY_NS) == 2 * S, "not less than the memory"
    assert delay.recent_ns(3 * S + 2 * MEMORY_NS) == 0


def test_delay_is_forgotten_without_being_read() -> None:
    delay = LoopDelay()
    delay.on_turn(S, 3 * S)
    assert delay.recent_ns(3 * S + 3 * MEMORY_NS) == 0
