"""The report's folder, the words about a mission, the mission's files."""

from pathlib import Path

import msgspec
import pytest

from swarmlab import experiment
from swarmlab.measure.clocks import ClockTruth
from swarmlab.report.run_metadata import NodeMetadata, failure
from swarmlab.run.mission_run import MissionRun
from swarmlab.run.notify import Restarts
from swarmlab.run.watch import MissionMembers, MissionOutcome
from swarmware.mission.folder import from_files
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState, OrderReceipt, TaskAnswer


def test_older_report_is_removed_and_others_stay(tmp_path: Path) -> None:
    out = tmp_path / "report"
    (out / "logs" / "uav1").mkdir(parents=True)
    (out / "mine").mkdir()
    for name in ("report.json", "run.json", "report.html", "paths.png", "notes.txt"):
        (out / name).write_text("old")
    experiment.prepare(out)
    assert sorted(path.name for path in out.iterdir()) == ["logs", "mine", "notes.txt"]
    assert list((out / "logs").iterdir()) == []
    experiment.prepare(tmp_path / "new" / "report")
    assert (tmp_path / "new" / "report" / "logs").is_dir()


def state(name: str, *active: str) -> MissionState:
    return msgspec.structs.replace(MissionState(1, "", MissionPhase(name)), active=active)


def test_the_phase_is_what_most_platforms_do() -> None:
    states = {"a": state("running", "form"), "b": state("running", "form"), "c": state("running", "formed")}
    assert experiment.phase(states) == "form 2, formed 1"
    assert experiment.phase({"a": state("done"), "b": state("failed")}) == "2 of 2 ended"
    assert experiment.phase({}) == ""


@pytest.mark.parametrize(
    ("states", "in_time", "failure"),
    [
        ({"a": "done", "b": "done"}, True, ""),
        ({"a": "done", "b": "aborted", "c": "failed"}, True, "b aborted, c failed"),
        ({"a": "done", "b": "running"}, False, "out of time: b running"),
        ({"a": "failed", "b": "idle"}, True, "a failed, b not started"),
        ({}, True, "no platform took part"),
    ],
)
def test_mission_completes_when_members_end_in_time(
    states: dict[str, str], in_time: bool, failure: str
) -> None:
    outcome = MissionOutcome(states, in_time)
    assert outcome.completed is (failure == "")
    assert outcome.failure() == failure


def test_experiment_sends_mission_with_all_files() -> None:
    task = experiment.mission_task("formation")
    folder = from_files(task.files, task.name)
    assert folder.manifest.name == "formation"
    assert len(folder.manifest.roles) >= 3


def of_epoch(epoch: int, name: str) -> MissionState:
    return MissionState(epoch, "", MissionPhase(name), active=("form",))


def test_restarted_member_is_not_awaited() -> None:
    members = MissionMembers(["a", "b", "c"], 7)
    members.take({"a": of_epoch(0, "idle"), "b": of_epoch(7, "running")})
    assert members.outcome(in_time=True).states == {"a": "unknown", "b": "running", "c": "unknown"}
    members.take({"a": of_epoch(7, "running"), "b": of_epoch(7, "done"), "c": of_epoch(7, "aborted")})
    assert members.outcome(in_time=True).states["a"] == "running"
    members.take({"a": of_epoch(0, "idle"), "b": of_epoch(0, "idle"), "z": of_epoch(7, "running")})
    assert members.ended
    assert members.outcome(in_time=True).failure() == "a lost, c aborted", "what was done stays done"
    assert experiment.phase(members.states) == "3 of 3 ended"


def test_members_withdrawn_at_start_are_not_awaited() -> None:
    members = MissionMembers(["a", "b"], 7)
    members.take({"a": of_epoch(7, "ready"), "b": of_epoch(7, "running")})
    before = members.ended
    members.take({"a": of_epoch(7, "idle"), "b": of_epoch(7, "failed")})
    assert (before, members.ended) == (False, True)
    assert members.outcome(in_time=True).failure() == "a not started, b failed"


def test_failed_mission_reports_reasons_of_members() -> None:
    members = MissionMembers(["a", "b"], 7)
    failed = MissionState(7, "", MissionPhase.FAILED, text="advance: timed out after 240 s")
    members.take({"a": failed, "b": of_epoch(7, "done")})
    assert members.outcome(in_time=True).failure() == "a failed (advance: timed out after 240 s)"


def node_facts(platform: str, *, ended: str = "", reasons: tuple[str, ...] = ()) -> NodeMetadata:
    return NodeMetadata(
        platform=platform, kind=PlatformKind.UAV, radius_m=0.3, clock=ClockTruth(0, 0),
        processes="one", outcome="",
        ended=ended, restarts=Restarts(len(reasons), reasons), log=f"logs/{platform}/log.txt",
    )  # fmt: skip


def test_failure_names_ended_nodes_before_consequences() -> None:
    nodes = [node_facts("a", ended="signal 9"), node_facts("b", reasons=("exit 1",))]
    assert failure(nodes, "out of time") == "node a: ended with signal 9; logs/a/log.txt"
    assert failure(nodes[1:], "out of time") == "out of time"
    assert failure(nodes[1:], "") == ""


def test_aborted_course_reports_its_progress() -> None:
    course = MissionRun()
    orders = tuple(OrderReceipt("formation", 7, name, "r", 0, 0, 0, True) for name in ("a", "b"))
    course.accepted(TaskAnswer("formation", "", 7, True, orders))
    course.members.take({"a": of_epoch(7, "running")})
    assert course.failure() == "a running, b unknown"
    course.error = "no answer"
    assert course.failure() == "no answer"
    assert course.percent("a") is None
