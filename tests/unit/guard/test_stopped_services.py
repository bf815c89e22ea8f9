"""Services that an operator stops and starts, in the core of the guard."""

import pytest
from tests.unit.guard.rig import SECOND, guard, running, service, spawned, until_something

from swarmd.guard.config import Config
from swarmd.guard.core.supervision import Action, GuardCore, Kill, Spawn, Stop, Terminate
from swarmware.errors import Denied
from swarmware.service.exit_status import ExitStatus
from swarmware.types.health import SupervisorKind


def ended(core: GuardCore, name: str, now_ns: int) -> list[Action]:
    return core.on_exit(name, service(core, name).pid, ExitStatus(code=0), now_ns)


def test_service_stopped_by_operator_stays_stopped() -> None:
    core = guard("tree", "logger")
    running(core)
    assert core.on_stop_order("logger", "ann@gcs", SECOND) == [Stop("logger", 20)]
    assert core.on_stop_order("logger", "bob@gcs", SECOND) == []
    assert ended(core, "logger", 2 * SECOND) == []
    stopped = service(core, "logger")
    assert (stopped.state, stopped.stopped_by, stopped.restarts) == ("stopped", "ann@gcs", 0)
    for _ in range(20):
        now_ns = core.deadline_ns() or 0
        core.on_timer(now_ns)
        core.on_heartbeat("tree", now_ns, now_ns)
        assert core.on_heartbeats_read(now_ns) == []
    assert core.on_start_order("logger", 60 * SECOND) == [Spawn("logger")]
    core.on_spawned("logger", 30, 60 * SECOND)
    core.on_joined("logger", 30, 60 * SECOND)
    back = service(core, "logger")
    assert (back.state, back.stopped_by, back.restarts) == ("running", "", 0)
    assert core.on_start_order("logger", 61 * SECOND) == []


def test_stopped_service_that_hangs_is_killed() -> None:
    core = guard("logger")
    running(core)
    core.on_stop_order("logger", "ann", 0)
    with pytest.raises(Denied, match="still being stopped"):
        core.on_start_order("logger", SECOND)
    assert core.on_restart_order("logger", SECOND) == []
    assert until_something(core) == (3 * SECOND, [Kill("logger", 10, "did not end when requested")])
    assert ended(core, "logger", 4 * SECOND) == []
    assert service(core, "logger").state == "stopped"


def test_pausing_service_stops_and_failed_service_starts() -> None:
    core = guard("logger", back_off_s=(5.0,), restart_limit=1)
    running(core)
    ended(core, "logger", 0)
    assert core.on_stop_order("logger", "ann", SECOND) == []
    assert service(core, "logger").state == "stopped"
    assert core.on_restart_order("logger", SECOND) == [Spawn("logger")], "a restart starts it, too"
    assert service(core, "logger").stopped_by == ""
    failing = guard("logger", restart_limit=1, back_off_s=(0.0,))
    running(failing)
    while service(failing, "logger").state != "failed":
        if service(failing, "logger").pid == 0:
            failing.on_spawned("logger", 7, 0)
        ended(failing, "logger", 0)
    assert failing.on_start_order("logger", SECOND) == [Spawn("logger")]


@pytest.mark.parametrize("name", ["broker", "guard"])
def test_services_needed_for_starting_cannot_be_stopped(name: str) -> None:
    core = guard("broker", "tree")
    running(core)
    with pytest.raises(Denied, match=f"'{name}': cannot be stopped: .*again"):
        core.on_stop_order(name, "ann", 0)
    assert service(core, "broker").state == "running"


def test_a_unit_of_systemd_is_stopped_by_systemctl() -> None:
    core = GuardCore(("tree",), SupervisorKind.SYSTEMD, Config())
    core.on_start({"tree": 7}, {}, 0)
    with pytest.raises(Denied, match="systemctl stop swarmd@tree"):
        core.on_stop_order("tree", "ann", 0)
    assert service(core, "tree").state == "running"


@pytest.mark.parametrize("before_its_end", [True, False])
def test_killed_guard_leaves_stopped_services_to_next(before_its_end: bool) -> None:
    core = guard("tree", "logger")
    running(core)
    core.on_stop_order("logger", "ann", 0)
    if not before_its_end:
        ended(core, "logger", 0)
    after = guard("tree", "logger")
    after.restore(core.status(), {"tree", "logger"})
    found = {"tree": 10, "logger": 20} if before_its_end else {"tree": 10}
    actions = after.on_start(found, {}, SECOND)
    assert spawned(actions) == []
    assert (Stop("logger", 20) in actions) is before_its_end
    if before_its_end:
        assert ended(after, "logger", 2 * SECOND) == []
    assert (service(after, "logger").state, service(after, "logger").stopped_by) == ("stopped", "ann")
    assert after.on_stop(3 * SECOND) == [Terminate("tree", 10)]


def test_all_services_process_runs_formerly_stopped_one() -> None:
    core = guard("tree", "logger")
    running(core)
    core.on_stop_order("logger", "ann", 0)
    after = guard("tree", "logger")
    after.restore(core.status())
    assert spawned(after.on_start({}, {}, SECOND)) == ["tree", "logger"]
    assert service(after, "logger").stopped_by == ""


def test_node_stops_also_while_service_is_being_stopped() -> None:
    core = guard("tree", "logger")
    running(core)
    core.on_stop_order("logger", "ann", 0)
    assert core.on_stop(0) == []
    assert ended(core, "logger", SECOND) == [Terminate("tree", 10)]
    ended(core, "tree", 2 * SECOND)
    assert core.stopped
