"""The report's folder, the words about a mission, the mission's files."""

from pathlib import Path

import msgspec
import pytest

from swarmctl.lab import experiment
from swarmctl.lab.watch import Outcome
from swarmware.mission.folder import from_files
from swarmware.types.mission import MissionState


def test_an_older_report_goes_and_whatever_else_is_there_stays(tmp_path: Path) -> None:
    out = tmp_path / "report"
    (out / "logs" / "uav1").mkdir(parents=True)
    (out / "mine").mkdir()
    for name in ("report.json", "run.json", "report.html", "formation-error.png", "notes.txt"):
        (out / name).write_text("old")
    experiment.prepare(out)
    assert sorted(path.name for path in out.iterdir()) == ["logs", "mine", "notes.txt"]
    assert list((out / "logs").iterdir()) == []
    experiment.prepare(tmp_path / "new" / "report")
    assert (tmp_path / "new" / "report" / "logs").is_dir()


def state(name: str, *active: str) -> MissionState:
    return msgspec.structs.replace(MissionState(1, "", name), active=active)


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
        ({}, True, "nobody took part"),
    ],
)
def test_a_mission_is_completed_when_every_member_is_done_in_time(
    states: dict[str, str], in_time: bool, failure: str
) -> None:
    outcome = Outcome(states, in_time)
    assert outcome.completed is (failure == "")
    assert outcome.failure() == failure


def test_the_mission_of_the_experiment_is_sent_with_all_its_files() -> None:
    task = experiment.mission_task("formation")
    folder = from_files(task.files, task.name)
    assert folder.manifest.name == "formation"
    assert len(folder.manifest.roles) >= 3
