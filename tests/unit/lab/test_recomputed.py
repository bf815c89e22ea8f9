"""A report computed again from its folder: its exit code, its remarks, its table for a page."""

from pathlib import Path

import msgspec
import pytest
from tests.unit.lab.logs import facts, write_logs

from swarmctl.commandline.settings import CliSettings
from swarmctl.terminal.output import Output
from swarmlab import experiment
from swarmlab.report import report
from swarmlab.report.report import ExperimentReport
from swarmware.errors import InvalidInput, NotFound


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_logs(tmp_path / "logs")
    write_facts(tmp_path, ready_s=4.5)
    return tmp_path


def write_facts(folder: Path, *, ready_s: float) -> None:
    known = msgspec.structs.replace(facts(), ready_s=ready_s)
    (folder / "run.json").write_bytes(msgspec.json.encode(known))


def test_a_missed_goal_fails_a_strict_run_only(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = Output(CliSettings())
    write_facts(folder, ready_s=99.0)
    assert experiment.report(folder, out) == 0
    assert "missed: ready: 99 s, goal below 15 s (2 cores (Some CPU))" in capsys.readouterr().err
    assert experiment.report(folder, out, strict=True) == 1
    assert "missed: ready" in (folder / "report.html").read_text()


def test_table_for_page_has_every_row_of_report(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    experiment.report(folder, Output(CliSettings()))
    capsys.readouterr()
    experiment.page_table(folder, Output(CliSettings()))
    table = capsys.readouterr().out.splitlines()
    found = msgspec.json.decode((folder / "report.json").read_bytes(), type=ExperimentReport)
    assert table[2:] == [f"| {row.what} | {row.ours} | {row.note} |" for row in report.comparison(found)]
    assert any("command to receipt | 6 ms" in line for line in table), "3 nodes: not beside the paper's 16"


def test_a_folder_without_a_report_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"report\.json: no such file"):
        experiment.page_table(tmp_path, Output(CliSettings()))
    (tmp_path / "report.json").write_text('{"nodes": "many"}')
    with pytest.raises(InvalidInput, match=r"report\.json: Expected `int`"):
        experiment.page_table(tmp_path, Output(CliSettings()))


def test_report_without_merged_file_does_not_link_it(folder: Path) -> None:
    experiment.report(folder, Output(CliSettings()))
    assert 'href="run.mcap"' not in (folder / "report.html").read_text()
    (folder / "run.mcap").write_bytes(b"")
    experiment.report(folder, Output(CliSettings()))
    assert 'href="run.mcap"' in (folder / "report.html").read_text()
