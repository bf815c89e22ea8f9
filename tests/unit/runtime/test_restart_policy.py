"""Restarts of a process: at once, with a back-off, given up."""

import pytest

from swarmware.runtime.backoff import RestartPolicy

SECOND = 1_000_000_000


def lives() -> RestartPolicy:
    return RestartPolicy(pauses_s=(0.0, 0.5, 2.0), settled_s=10.0, limit=4)


def test_one_that_never_gets_ready_is_started_with_growing_pauses_and_then_given_up() -> None:
    made = lives()
    assert [made.on_end(second * SECOND, killed=False) for second in range(5)] == [0.0, 0.5, 2.0, 2.0, None]
    assert made.restarts == 4


def test_one_that_lasted_is_started_again_at_once_however_often() -> None:
    made = lives()
    for life in range(100):
        made.on_ready(life * 100 * SECOND)
        assert made.on_end((life * 100 + 10) * SECOND, killed=False) == 0.0
    assert made.restarts == 100


def test_a_kill_from_outside_says_nothing_about_a_process_that_was_ready() -> None:
    made = lives()
    for life in range(50):
        made.on_ready(life * SECOND)
        assert made.on_end(life * SECOND + 1, killed=True) == 0.0


@pytest.mark.parametrize("ready", [False, True])
def test_a_short_life_counts_as_a_failure_unless_it_was_ready_and_killed(ready: bool) -> None:
    made = lives()
    pauses = []
    for second in range(3):
        if ready:
            made.on_ready(second * SECOND)
        pauses.append(made.on_end(second * SECOND + 1, killed=not ready))
    assert pauses == [0.0, 0.5, 2.0]


def test_without_a_limit_it_is_never_given_up_and_an_operator_starts_the_count_again() -> None:
    made = RestartPolicy(pauses_s=(0.0, 1.0), limit=0)
    assert [made.on_end(0) for _ in range(40)] == [0.0, *[1.0] * 39]
    made.reset()
    assert made.on_end(0) == 0.0
    assert (made.consecutive, made.restarts) == (1, 41)


def test_by_default_one_that_crashes_every_three_seconds_is_started_again_at_once_without_end() -> None:
    made = RestartPolicy()
    for life in range(1000):
        made.on_ready(3 * life * SECOND)
        assert made.on_end((3 * life + 2) * SECOND) == 0.0
    assert made.restarts == 1000
