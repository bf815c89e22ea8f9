"""Guard core: starts and kills after ends, heartbeats and orders."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.guard.rig import SECOND, guard, running, service, spawned, until_something, without_tell

from swarmd.guard.core.supervision import (
    TRANSITIONS,
    Action,
    ClearStartRecord,
    Kill,
    ReadHeartbeats,
    ReportRestart,
    ServiceEvent,
    Spawn,
    Terminate,
    WatchProcess,
)
from swarmware.service.exit_status import ExitStatus
from swarmware.testing.virtual import VirtualTime
from swarmware.types.health import GuardStatus, ServiceState, SupervisorKind, WatchedService


def test_stopped_services_are_all_started_in_order() -> None:
    assert spawned(guard("tree", "health", "sim").on_start({"health": 7}, {}, 0)) == ["tree", "sim"]


def test_what_runs_already_is_adopted() -> None:
    core = guard()
    actions = core.on_start({"health": 7}, {}, 0)
    assert actions == [Spawn("tree"), ClearStartRecord("health"), WatchProcess("health", 7)]
    assert (service(core, "health").state, service(core, "health").pid) == ("running", 7)
    assert service(core, "health").adopted


def test_process_started_by_former_guard_is_awaited() -> None:
    core = guard()
    assert core.on_start({}, {"health": 7}, 0) == [Spawn("tree"), WatchProcess("health", 7)]
    assert service(core, "health").state == "starting"
    assert core.on_joined("health", 7, SECOND) == [ClearStartRecord("health")], "its end is awaited already"
    assert service(core, "health").state == "running"


def test_a_dead_service_is_started_again_at_once() -> None:
    core = guard()
    running(core)
    actions = core.on_exit("tree", 10, ExitStatus(signal=9), SECOND)
    assert without_tell(actions) == [Spawn("tree")]
    assert isinstance(actions[0], ReportRestart)
    assert actions[0].service.reason == "died: signal 9"
    assert service(core, "tree").restarts == 1


def test_repeatedly_dying_service_waits_then_is_abandoned() -> None:
    core = guard()
    running(core)
    now_ns, pauses = SECOND, []
    for attempt in range(1, 6):
        pid = 10 if attempt == 1 else 100 + attempt - 1
        actions = without_tell(core.on_exit("tree", pid, ExitStatus(code=1), now_ns))
        if not actions:
            if service(core, "tree").state == "failed":
                break
            core.on_heartbeat("health", attempt, now_ns)
            began_ns = now_ns
            now_ns, actions = until_something(core)
            pauses.append((now_ns - began_ns) / SECOND)
        assert actions == [Spawn("tree")]
        core.on_spawned("tree", 100 + attempt, 0)
    assert pauses == [0.5, 2.0, 2.0]
    assert service(core, "tree").state == "failed"
    assert "given up after 4 restarts" in service(core, "tree").reason


def test_long_running_service_restarts_without_pause() -> None:
    core = guard()
    running(core)
    core.on_exit("tree", 10, ExitStatus(code=1), SECOND)
    core.on_spawned("tree", 11, 0)
    core.on_joined("tree", 11, 2 * SECOND)
    assert without_tell(core.on_exit("tree", 11, ExitStatus(code=1), 13 * SECOND)) == [Spawn("tree")]


def test_operator_can_revive_one_that_was_given_up() -> None:
    core = guard(restart_limit=1)
    running(core)
    core.on_exit("tree", 10, ExitStatus(code=1), SECOND)
    core.on_spawned("tree", 11, 0)
    core.on_exit("tree", 11, ExitStatus(code=1), SECOND)
    assert service(core, "tree").state == "failed"
    assert core.on_restart_order("tree", 2 * SECOND) == [Spawn("tree")]


def test_stale_beat_is_hang_and_kill() -> None:
    core = guard("tree")
    running(core)
    for second in range(1, 4):
        core.on_heartbeat("tree", second, second * SECOND)
    for second in range(4, 8):
        core.on_heartbeat("tree", 3, second * SECOND)
        assert core.on_heartbeats_read(second * SECOND) == []
    core.on_heartbeat("tree", 3, 8 * SECOND)
    assert core.on_heartbeats_read(8 * SECOND) == [Kill("tree", 10, "hung: no beat for 5.0 s")]
    core.on_exit("tree", 10, ExitStatus(signal=9), 8 * SECOND)
    assert service(core, "tree").reason == "hung: no beat for 5.0 s"


def test_one_that_never_joins_the_node_is_killed() -> None:
    core = guard("tree")
    core.on_start({}, {}, 0)
    core.on_spawned("tree", 10, 0)
    assert core.on_heartbeats_read(20 * SECOND) == [
        Kill("tree", 10, "hung: not on the node 20 s after its start")
    ]


def test_time_without_guard_blames_no_service() -> None:
    core = guard("tree")
    running(core)
    assert core.on_heartbeats_read(30 * SECOND) == []
    assert core.on_heartbeats_read(32 * SECOND) == []
    assert core.on_heartbeats_read(33 * SECOND) == [Kill("tree", 10, "hung: no beat for 5.5 s")]


def test_restart_on_request_asks_first_and_kills_later() -> None:
    core = guard("tree")
    running(core)
    assert core.on_restart_order("tree", SECOND) == [Terminate("tree", 10)]
    core.on_heartbeat("tree", 99, 2 * SECOND)
    assert core.on_heartbeats_read(4 * SECOND) == [Kill("tree", 10, "restarted on request")]
    assert without_tell(core.on_exit("tree", 10, ExitStatus(signal=9), 4 * SECOND)) == [Spawn("tree")]
    assert service(core, "tree").reason == "restarted on request"


def test_end_of_namesake_process_means_nothing() -> None:
    core = guard()
    running(core)
    assert core.on_exit("tree", 99, ExitStatus(signal=9), SECOND) == []
    assert service(core, "tree").state == "running"


def test_service_dying_during_stop_is_not_restarted() -> None:
    core = guard("broker", "tree", "sim")
    running(core)
    assert core.on_stop(0) == [Terminate("sim", 30)]
    assert core.on_exit("tree", 20, ExitStatus(signal=9), 1) == []
    assert core.on_exit("sim", 30, ExitStatus(code=0), 2) == [Terminate("broker", 10)]
    assert not core.stopped
    core.on_exit("broker", 10, ExitStatus(code=0), 3)
    assert core.stopped


def test_service_awaiting_start_is_not_started_by_stop() -> None:
    core = guard("tree")
    running(core)
    core.on_exit("tree", 10, ExitStatus(code=1), SECOND)
    core.on_spawned("tree", 11, 0)
    assert without_tell(core.on_exit("tree", 11, ExitStatus(code=1), SECOND)) == []
    core.on_stop(SECOND)
    assert core.stopped
    assert core.on_heartbeats_read(9 * SECOND) == []
    assert core.on_restart_order("tree", 9 * SECOND) == []


def test_stopping_is_complete_and_nothing_is_started_again() -> None:
    core = guard("broker", "tree", "sim")
    running(core)
    asked: list[str] = []
    actions = core.on_stop(0)
    while actions:
        assert len(actions) == 1
        action = actions[0]
        assert isinstance(action, Terminate)
        asked.append(action.service)
        actions = core.on_exit(action.service, action.pid, ExitStatus(code=0), 1)
    assert asked == ["sim", "tree", "broker"]
    assert core.stopped


def test_service_that_ignores_stop_is_killed() -> None:
    core = guard("tree")
    running(core)
    core.on_stop(0)
    assert core.on_heartbeats_read(3 * SECOND) == [Kill("tree", 10, "did not end when requested")]
    core.on_exit("tree", 10, ExitStatus(signal=9), 3 * SECOND)
    assert core.stopped


def test_new_guard_continues_counters_of_killed_one() -> None:
    core = guard()
    before = GuardStatus(
        SupervisorKind.SELF,
        (WatchedService("tree", ServiceState.RUNNING, restarts=3, reason="died: signal 11"),),
        3,
    )
    core.restore(before)
    core.on_start({"tree": 5, "health": 6}, {}, 0)
    assert service(core, "tree").restarts == 3
    assert core.status().restarts == 3


def test_death_without_guard_is_counted_and_reported() -> None:
    core = guard()
    core.restore(GuardStatus(SupervisorKind.SELF, (WatchedService("tree", ServiceState.RUNNING, pid=5),), 0))
    tell, *spawns = core.on_start({}, {}, 0)
    assert isinstance(tell, ReportRestart)
    assert (tell.service.name, tell.service.reason) == ("tree", "died while no guard ran")
    assert spawns == [Spawn("tree"), Spawn("health")]
    assert service(core, "tree").restarts == 1


def test_restart_by_runner_is_counted_and_reported() -> None:
    core = guard("tree")
    core.on_start({"tree": 1}, {}, 0)
    told = core.on_restarted("tree", 2, SECOND)
    assert [type(action) for action in told] == [ReportRestart]
    assert service(core, "tree").restarts == 2
    assert core.on_restarted("tree", 2, SECOND) == []


@pytest.mark.parametrize("state", ServiceState)
def test_every_state_but_the_last_can_be_stopped(state: ServiceState) -> None:
    if state not in {ServiceState.STOPPED, ServiceState.STOPPING}:
        assert TRANSITIONS[state, ServiceEvent.STOP] in {ServiceState.STOPPING, ServiceState.STOPPED}


@given(st.lists(st.tuples(st.sampled_from(["exit", "beat", "timer", "join", "order"]), st.integers(0, 9))))
def test_whatever_happens_a_stop_ends_everything(events: list[tuple[str, int]]) -> None:
    core = guard("tree")
    pids = {"tree": 1}
    next_pid = 2
    now_ns = 0

    def carry_out(actions: list[Action]) -> None:
        nonlocal next_pid
        for action in actions:
            if isinstance(action, Spawn):
                pids["tree"] = next_pid
                core.on_spawned("tree", next_pid, now_ns)
                next_pid += 1

    carry_out(core.on_start({}, {}, 0))
    for what, value in events:
        now_ns += value * SECOND
        match what:
            case "exit":
                carry_out(core.on_exit("tree", pids["tree"], ExitStatus(code=1), now_ns))
            case "beat":
                core.on_heartbeat("tree", value, now_ns)
            case "timer":
                carry_out(core.on_heartbeats_read(now_ns))
            case "join":
                core.on_joined("tree", pids["tree"], now_ns)
            case _:
                carry_out(core.on_restart_order("tree", now_ns))
    core.on_stop(now_ns)
    if not core.stopped:
        core.on_exit("tree", pids["tree"], ExitStatus(code=0), now_ns)
    assert core.stopped
    assert core.deadline_ns() is None


class Watching:
    """A guard in virtual time, whose services join after their start and beat unless they are hung."""

    def __init__(self, fails_to_start: set[str] | None = None) -> None:
        self.time = VirtualTime()
        self.core = guard("tree", "sim")
        self.driver = self.time.drive(self.core, self.perform)
        self.pids = {"tree": 0, "sim": 0}
        self.beats = {"tree": 0, "sim": 0}
        self.well = {"tree", "sim"}
        self.done: list[Action] = []
        self.looks = 0
        self.fails_to_start = fails_to_start or set()
        self.time.every(1.0, self.beat)
        self.driver.feed(self.core.on_start({}, {}, 0))

    def beat(self) -> None:
        for name in self.well:
            self.beats[name] += 1

    def perform(self, action: Action) -> None:
        now_ns = self.time.now_ns
        self.done.append(action)
        match action:
            case ReadHeartbeats():
                self.looks += 1
                actions: list[Action] = []
                for name, pid in self.pids.items():
                    if pid:
                        actions += self.core.on_joined(name, pid, now_ns)
                    actions += self.core.on_heartbeat(name, self.beats[name], now_ns)
                self.driver.feed(actions + self.core.on_heartbeats_read(now_ns))
            case Spawn(name):
                self.pids[name] += 10
                self.driver.feed(self.core.on_spawned(name, self.pids[name], now_ns))
            case WatchProcess(name, pid) if name in self.fails_to_start:
                self.fails_to_start.discard(name)
                self.driver.feed(self.core.on_exit(name, pid, ExitStatus(), now_ns))
            case Kill(name, pid):
                self.driver.feed(self.core.on_exit(name, pid, ExitStatus(signal=9), now_ns))


def test_guard_checks_each_second_and_kills_hung() -> None:
    watching = Watching()
    watching.time.run_for(10)
    assert watching.looks in {10, 11}
    assert {one.state for one in watching.core.status().services} == {"running"}
    watching.well.discard("sim")
    watching.time.run_for(7)
    assert [action for action in watching.done if isinstance(action, Kill)] == [
        Kill("sim", 10, "hung: no beat for 5.0 s")
    ]
    assert service(watching.core, "sim").restarts == 1


@pytest.mark.parametrize("away_s", [2, 5, 6, 7, 30])
def test_beats_during_guards_absence_count(away_s: int) -> None:
    watching = Watching()
    watching.time.run_for(10)
    watching.time.now_ns += away_s * SECOND  # the process was stopped; the services went on
    watching.beat()
    watching.time.run_for(10)
    assert not [action for action in watching.done if isinstance(action, Kill)]


def test_unfollowable_process_is_started_after_others() -> None:
    watching = Watching(fails_to_start={"tree"})
    assert spawned(watching.done) == ["tree", "sim", "tree"]


def test_guard_of_stopped_services_checks_no_longer() -> None:
    watching = Watching()
    watching.time.run_for(5)
    for name, pid in (("sim", 10), ("tree", 10)):
        watching.driver.feed(watching.core.on_stop(watching.time.now_ns))
        watching.driver.feed(watching.core.on_exit(name, pid, ExitStatus(code=0), watching.time.now_ns))
    assert watching.core.stopped
    looks = watching.looks
    watching.time.run_for(5)
    assert watching.looks == looks
