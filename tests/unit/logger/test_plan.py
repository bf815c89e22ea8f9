"""Logged resources and their sampling periods."""

import pytest

from swarmd.logger.core.sampling_plan import SamplingPlan, logged_resource
from swarmware.model import template
from swarmware.model.config import share_dir
from swarmware.model.resource import Kind, Resource

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("kind", "log", "every", "period_ns"),
    [
        (Kind.BOARD, "10hz", False, SECOND // 10),
        (Kind.BOARD, "all", False, 0),
        (Kind.EVENT, "all", True, 0),
        (Kind.STREAM, "2hz", False, SECOND // 2),
        (Kind.COMMAND, "all", True, 0),
    ],
)
def test_a_resource_is_logged_as_its_descriptor_says(
    kind: Kind, log: str, every: bool, period_ns: int
) -> None:
    made = logged_resource(Resource(path="a/b", kind=kind, type="Int", log=log, owner="me"))
    assert made is not None
    assert (made.every_value, made.period_ns, made.module) == (every, period_ns, "me")


def test_unlogged_resource_has_no_track() -> None:
    assert logged_resource(Resource(path="a/b", type="Int", log="none")) is None
    assert logged_resource(Resource(path="a/b", type="Int", log="0hz")) is None
    assert logged_resource(Resource(path="a", kind=Kind.BRANCH, log="all")) is None


def test_the_plan_follows_the_table() -> None:
    plan = SamplingPlan()
    one = Resource(path="a", type="Int", log="all")
    two = Resource(path="b", type="Int", log="10hz")
    assert [made.path for made in plan.update([two, one])[0]] == ["a", "b"]
    assert plan.update([one, two]) == ([], [])
    faster = Resource(path="b", type="Int", log="20hz")
    opened, closed = plan.update([faster])
    assert ([made.path for made in opened], closed) == (["b"], ["a", "b"])
    assert plan.update([faster]) == ([], [])


def test_decimated_resource_keeps_rate_despite_late_checks() -> None:
    plan = SamplingPlan()
    plan.update([Resource(path="a", type="Int", log="10hz")])
    looks = [
        start + late
        for start, late in zip(range(0, 10 * SECOND, SECOND // 50), [0, 7, 13] * 200, strict=False)
    ]
    assert sum(plan.due("a", now_ns) for now_ns in looks) == 100


def test_only_decimated_resource_waits_between_samples() -> None:
    plan = SamplingPlan()
    plan.update([Resource(path="a", type="Int", log="1hz"), Resource(path="b", type="Int", log="all")])
    assert not plan.waits("a", 0)
    assert plan.due("a", 0)
    assert plan.due("b", 0)
    assert plan.waits("a", SECOND - 1)
    assert not plan.waits("a", SECOND)
    assert not plan.waits("b", 1)


@pytest.mark.parametrize("name", ["multirotor", "ugv", "usv"])
def test_boards_state_and_mission_progress_are_logged(name: str) -> None:
    plan = SamplingPlan()
    opened, _ = plan.update(template.load(name, share_dir() / "templates").resources)
    tracks = {made.path: made for made in opened}
    decimated = {"nav/pose": 10, "power/battery": 1, "sensor/gnss": 1}
    assert {path: SECOND // tracks[path].period_ns for path in decimated} == decimated
    changes = ("health/state", "mission/state")
    assert [(tracks[path].every_value, tracks[path].period_ns) for path in changes] == [(False, 0)] * 2
    each = ("health/faults", "mission/progress", "mission/orders")
    assert all(tracks[path].every_value for path in each)
