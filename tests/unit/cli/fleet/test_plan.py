"""Steps on a host as a table: what is there, the goal, and what is done next."""

import msgspec
import pytest

from swarmctl.commands.fleet.listing import config_state, state_text
from swarmctl.commands.fleet.plan import ABSENT, FleetGoal, HostStatus, HostTarget, Step, next_step
from swarmware.errors import Conflict, NotFound, SwarmError

BARE = HostStatus(installed=True, version="1", wheel="old")
READY = msgspec.structs.replace(BARE, configured=True, config="new")
SILENT = msgspec.structs.replace(READY, running=True)
RUNS = msgspec.structs.replace(SILENT, answers=True)
HALF = msgspec.structs.replace(READY, resume=True)
NEW = {"wheel": "new"}


def after(status: HostStatus, **change: object) -> HostStatus:
    return msgspec.structs.replace(status, **change)


@pytest.mark.parametrize(
    ("wanted", "seen", "done", "step"),
    [
        (HostTarget(FleetGoal.PUSH, config="new"), BARE, (), Step.PUSH),
        (HostTarget(FleetGoal.PUSH, config="new"), READY, (), None),
        (HostTarget(FleetGoal.PUSH, config="new"), after(RUNS, config="old"), (), Step.PUSH),
        (HostTarget(FleetGoal.PUSH, "new", "new"), ABSENT, (), Step.UPLOAD),
        (HostTarget(FleetGoal.PUSH, "new", "new"), ABSENT, (Step.UPLOAD,), Step.INSTALL),
        (HostTarget(FleetGoal.PUSH, "old", "new"), RUNS, (), None),
        (HostTarget(FleetGoal.UP), READY, (), Step.START),
        (HostTarget(FleetGoal.UP), SILENT, (), Step.START),
        (HostTarget(FleetGoal.UP), RUNS, (), None),
        (HostTarget(FleetGoal.UP, synchronise=True), RUNS, (), Step.SYNCHRONISE),
        (HostTarget(FleetGoal.UP, synchronise=True), RUNS, (Step.SYNCHRONISE,), None),
        (HostTarget(FleetGoal.DOWN), RUNS, (), Step.STOP),
        (HostTarget(FleetGoal.DOWN), SILENT, (), Step.STOP),
        (HostTarget(FleetGoal.DOWN), HALF, (), Step.STOP),
        (HostTarget(FleetGoal.DOWN), READY, (), None),
        (HostTarget(FleetGoal.DOWN), ABSENT, (), None),
        (HostTarget(FleetGoal.UPGRADE, "new"), RUNS, (), Step.UPLOAD),
        (HostTarget(FleetGoal.UPGRADE, "new"), RUNS, (Step.UPLOAD,), Step.STOP),
        (HostTarget(FleetGoal.UPGRADE, "new"), HALF, (Step.UPLOAD, Step.STOP), Step.INSTALL),
        (HostTarget(FleetGoal.UPGRADE, "new"), after(HALF, **NEW), (), Step.START),
        (HostTarget(FleetGoal.UPGRADE, "new"), after(READY, **NEW), (), None),
        (HostTarget(FleetGoal.UPGRADE, "new"), after(RUNS, **NEW), (), None),
        (HostTarget(FleetGoal.UPGRADE, "new", "", True), after(RUNS, **NEW), (Step.START,), Step.SYNCHRONISE),
        (HostTarget(FleetGoal.UPGRADE, "new"), READY, (Step.UPLOAD,), Step.INSTALL),
    ],
)
def test_the_next_step_follows_from_what_is_there(
    wanted: HostTarget, seen: HostStatus, done: tuple[Step, ...], step: Step | None
) -> None:
    assert next_step(wanted, seen, done) == step


@pytest.mark.parametrize(
    ("wanted", "seen", "done", "error"),
    [
        (HostTarget(FleetGoal.PUSH, "new", "new"), RUNS, (), Conflict),
        (HostTarget(FleetGoal.PUSH, config="new"), ABSENT, (), NotFound),
        (HostTarget(FleetGoal.UP), ABSENT, (), NotFound),
        (HostTarget(FleetGoal.UP), BARE, (), NotFound),
        (HostTarget(FleetGoal.UP), READY, (Step.START,), SwarmError),
        (HostTarget(FleetGoal.DOWN), RUNS, (Step.STOP,), SwarmError),
    ],
)
def test_unreachable_goal_is_refused_and_steps_run_once(
    wanted: HostTarget, seen: HostStatus, done: tuple[Step, ...], error: type[SwarmError]
) -> None:
    with pytest.raises(error):
        next_step(wanted, seen, done)


def effect(step: Step, seen: HostStatus, wanted: HostTarget) -> HostStatus:
    """What a step changes on a host."""
    changes: dict[Step, dict[str, object]] = {
        Step.INSTALL: {"installed": True, "version": "2", "wheel": wanted.wheel},
        Step.PUSH: {"configured": True, "config": wanted.config},
        Step.STOP: {"running": False, "answers": False, "resume": wanted.goal is FleetGoal.UPGRADE},
        Step.START: {"running": True, "answers": True, "resume": False},
    }
    return after(seen, **changes.get(step, {}))


@pytest.mark.parametrize("wanted", [HostTarget(goal, "new", "new") for goal in FleetGoal])
@pytest.mark.parametrize("begin", [BARE, READY, SILENT, RUNS, HALF])
@pytest.mark.parametrize("interrupted_after", range(5))
def test_an_interrupted_command_ends_as_an_uninterrupted_one(
    wanted: HostTarget, begin: HostStatus, interrupted_after: int
) -> None:
    def ends(seen: HostStatus, limit: int) -> HostStatus | type[SwarmError]:
        done: list[Step] = []
        try:
            while len(done) < limit and (step := next_step(wanted, seen, done)) is not None:
                done.append(step)
                seen = effect(step, seen, wanted)
        except SwarmError as error:
            return type(error)
        return seen

    first = ends(begin, interrupted_after)
    second = ends(first, 10) if isinstance(first, HostStatus) else first
    assert second == ends(begin, 10)


def test_host_is_described_by_operators_next_action() -> None:
    assert [state_text(one) for one in (None, ABSENT, BARE, READY, HALF, SILENT, RUNS)] == [
        "failed", "not installed", "not configured", "stopped", "being upgraded", "silent", "running",
    ]  # fmt: skip
    assert config_state(BARE, "new") == "none"
    assert config_state(RUNS, "newer") == "changed"
    assert config_state(RUNS, "new") == "current"
    assert config_state(after(RUNS, started_config="old"), "new") == "restart"
