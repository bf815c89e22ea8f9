"""Restarts of a process: at once, with a back-off, given up."""

import pytest

from swarmware.runtime.backoff import RestartPolicy

SECOND = 1_000_000_000


def lives() -> RestartPolicy:
    return RestartPolicy(pauses_s=(0.0, 0.5, 2.0), settled_s=10.0, limit=4)


def test_service_never_ready_pauses_longer_then_abandoned() -> None:
    made = lives()
    assert [made.on_end(second * SECOND, killed=False) for second in range(5)] == [0.0, 0.5, 2.0, 2.0, None]
    assert made.restarts == 4


def test_lasting_service_always_restarts_at_once() -> None:
    made = lives()
    for life in range(100):
        made.on_ready(life * 100 * SECOND)
        assert made.on_end((life * 100 + 10) * SECOND, killed=False) == 0.0
    assert made.restarts == 100


def test_outside_kill_does_not_judge_ready_process() -> None:
    made = lives()
    for life in range(50):
        made.on_ready(life * SECOND)
        assert made.on_end(life * SECOND + 1, killed=True) == 0.0


@pytest.mark.parametrize("ready", [False, True])
def test_short_life_is_failure_unless_killed_ready(ready: bool) -> None:
    made = lives()
    pauses = []
    for second in range(3):
        if ready:
            made.on_ready(second * SECOND)
        pauses.append(made.on_end(second * SECOND + 1, killed=not ready))
    assert pauses == [0.0, 0.5, 2.0]


def test_unlimited_policy_never_abandons_and_operator_resets() -> None:
    made = RestartPolicy(pauses_s=(0.0, 1.0), limit=0)
    assert [made.on_end(0) for _ in range(40)] == [0.0, *[1.0] * 39]
    made.reset()
    assert made.on_end(0) == 0.0
    assert (made.consecutive, made.restarts) == (1, 41)


def test_default_policy_restarts_crashes_every_three_seconds() -> None:
    made = RestartPolicy()
    for life in range(1000):
        made.on_ready(3 * life * SECOND)
        assert made.on_end((3 * life + 2) * SECOND) == 0.0
    assert made.restarts == 1000
