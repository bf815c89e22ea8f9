"""Priorities by load: demotion, promotion and reset; without the rights, cores only."""

from collections.abc import Iterable

import pytest

from swarmd.guard.core.priorities import (
    DEMOTED,
    PROMOTED,
    PriorityCore,
    ProcessPriority,
    ServiceLoad,
    SetPriority,
)
from swarmd.guard.priorities import ProcessPriorities, lowest_nice
from swarmware.types.system import AppState, AppStatus

S = 1_000_000_000
QUIET = (ServiceLoad("mission", 1, 3.0, 2.0), ServiceLoad("logger", 2, 60.0, 2.0))
LATE = (ServiceLoad("mission", 1, 3.0, 40.0), ServiceLoad("logger", 2, 60.0, 2.0))


def run(
    core: PriorityCore, seconds: Iterable[int], busy_ratio: float, loads: Iterable[ServiceLoad]
) -> list[tuple[int, str, ProcessPriority]]:
    """Second, service and priority of each action."""
    found = []
    for second in seconds:
        for action in core.on_loads(busy_ratio, loads, second * S):
            assert isinstance(action, SetPriority)
            found.append((second, action.name, action.priority))
    return found


@pytest.mark.parametrize(
    ("cores", "lowest_nice", "heavy", "late"),
    [
        ((0, 1), -20, ProcessPriority(DEMOTED, (1,)), ProcessPriority(PROMOTED)),
        ((0, 1, 2, 3), -2, ProcessPriority(DEMOTED, (1, 2, 3)), ProcessPriority(-2)),
        ((0,), -20, ProcessPriority(DEMOTED), ProcessPriority(PROMOTED)),
        ((0, 1), 0, ProcessPriority(DEMOTED, (1,)), ProcessPriority(0)),
        ((0, 1), 20, ProcessPriority(0, (1,)), ProcessPriority()),
        ((0,), 20, ProcessPriority(), ProcessPriority()),
    ],
)
def test_heavy_process_yields_and_late_precedes(
    cores: tuple[int, ...], lowest_nice: int, heavy: ProcessPriority, late: ProcessPriority
) -> None:
    core = PriorityCore(cores, lowest_nice)
    run(core, range(10), 0.95, LATE)
    assert core.pressed
    assert (core.of("logger"), core.of("mission")) == (heavy, late)


def test_short_peak_sets_nothing_and_rest_resets() -> None:
    core = PriorityCore((0, 1), -20)
    assert run(core, range(3), 0.95, LATE) == []
    assert run(core, range(3, 60), 0.5, LATE) == []
    acts = run(core, range(60, 70), 0.95, LATE)
    assert {(name, priority.nice) for _, name, priority in acts} == {("logger", 5), ("mission", -5)}
    assert run(core, range(70, 200), 0.8, QUIET) == [], "between both limits nothing changes"
    assert run(core, range(200, 209), 0.5, QUIET) == [], "for less than ten seconds"
    relaxed = run(core, range(209, 220), 0.5, QUIET)
    assert sorted(name for _, name, _ in relaxed) == ["logger", "mission"]
    assert {priority for _, _, priority in relaxed} == {ProcessPriority()}


def test_lightened_process_regains_priority_later() -> None:
    core = PriorityCore((0, 1), -20)
    run(core, range(10), 0.95, QUIET)
    assert core.of("logger").nice == DEMOTED
    light = (ServiceLoad("logger", 2, 5.0, 2.0),)
    assert run(core, range(10, 60), 0.95, light) == []
    assert core.of("logger").nice == DEMOTED


def test_new_process_begins_with_default_priority() -> None:
    core = PriorityCore((0, 1), -20)
    run(core, range(10), 0.95, QUIET)
    again = (ServiceLoad("logger", 9, 60.0, 2.0),)
    assert run(core, range(10, 12), 0.95, again) == []
    assert core.of("logger") == ProcessPriority()
    assert run(core, range(12, 13), 0.95, again) == [(12, "logger", ProcessPriority(DEMOTED, (1,)))]
    run(core, range(13, 14), 0.95, ())
    assert core.of("logger") == ProcessPriority()


@pytest.mark.parametrize("name", ["guard", "health", "broker", "hal", "control"])
def test_what_others_depend_on_never_yields(name: str) -> None:
    core = PriorityCore((0, 1), -20)
    assert run(core, range(20), 1.0, (ServiceLoad(name, 1, 90.0, 50.0),)) == []


def test_refused_priority_is_not_set_again() -> None:
    core = PriorityCore((0, 1), -20)
    run(core, range(10), 0.95, QUIET)
    core.on_refused("logger")
    assert run(core, range(10, 100), 0.95, QUIET) == []
    core.on_found("mission", 1, ProcessPriority(PROMOTED))
    acts = run(core, range(100, 130), 0.1, QUIET)
    assert ("mission", ProcessPriority()) in {(name, priority) for _, name, priority in acts}


def test_real_process_that_is_refused_is_left_alone(caplog: pytest.LogCaptureFixture) -> None:
    priorities = ProcessPriorities()
    gone = AppStatus(2**22 - 1, AppState.RUNNING, 1, cpu_percent=90.0)
    for second in range(1, 30):
        priorities.sample([("logger", gone)], second * S)
    assert priorities.of("planner") == ProcessPriority()
    assert -20 <= lowest_nice() <= 20
