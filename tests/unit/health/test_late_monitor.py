"""A monitor with a delayed event loop, whose delay does not count as the age of resources."""

from swarmd.health.config import Config
from swarmd.health.core.monitor import FaultChanged, MonitorCore, RunningApp
from swarmware.model.resource import Resource

SECOND = 1_000_000_000
HALF = SECOND // 2
POSE = Resource(path="nav/pose", type="Pose", rate_hz=20, critical=True)


def look(core: MonitorCore, position: int, now_ns: int) -> list[str]:
    """States of the faults after a sample of the pose."""
    (age,) = core.ages()
    actions = core.on_age_sample(age, position, now_ns)
    return [action.fault.state for action in actions if isinstance(action, FaultChanged)]


def late_monitor(late_ns: int) -> tuple[MonitorCore, int]:
    """A monitor that has seen a pose and is called late; returns the monitor and the instant of the call."""
    core = MonitorCore(Config(grace_s=1.0))
    core.on_start((), (), 0)
    core.on_running(RunningApp("navigator#1", "navigator", 7, -20 * SECOND, (POSE,)), 0)
    due_ns = core.deadline_ns()
    assert due_ns is not None
    core.on_timer(due_ns)
    look(core, 1, due_ns)
    due_ns = core.deadline_ns()
    assert due_ns is not None
    core.on_timer(due_ns + late_ns)
    return core, due_ns + late_ns


def test_lateness_of_monitor_is_not_age() -> None:
    core, now_ns = late_monitor(5 * SECOND)
    (age,) = core.ages()
    assert age.age_s(now_ns) == 0.5, "the time between two looks"
    look(core, 1, now_ns)
    assert look(core, 2, now_ns + HALF) == []


def test_absent_pose_is_lost_on_late_node() -> None:
    core, now_ns = late_monitor(5 * SECOND)
    found = [state for half in range(9) for state in look(core, 1, now_ns + half * HALF)]
    assert found == ["stale", "lost"]


def test_slightly_late_check_leaves_age_unchanged() -> None:
    core, now_ns = late_monitor(SECOND // 10)
    (age,) = core.ages()
    assert age.age_s(now_ns) == 0.6
