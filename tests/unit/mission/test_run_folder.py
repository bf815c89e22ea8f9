"""The folders of runs on the disk, also on a disk that takes nothing."""

import logging
from pathlib import Path

import pytest

from swarmd.mission import run_folder
from swarmd.mission.run_folder import RunDisk
from swarmware.errors import NotFound
from swarmware.mission.finding import Finding
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Member, MissionOrder, MissionProgress

UTC_NS = 1_790_000_000_000_000_000
"""2026-09-21T14:13:20Z, less the clock of the platform."""
NAME = "20260921T141320Z-formation"
WARNING = Finding("up.json", 3, "", "warning", "broken-barrier", "no successor")


def order(epoch: int, mission: str = "formation") -> MissionOrder:
    return MissionOrder(
        mission=mission,
        hash="ab" * 16,
        epoch=epoch,
        role="scout",
        file="up.json",
        text='{"mission": {}}',
        text_hash="cd" * 16,
        members=(Member("uav1", "scout", PlatformKind.UAV),),
        params={"height_m": 5.0, "course": ((1.0, 2.0),)},
        issuer="gcs",
        issued_ns=1,
        expires_ns=2,
        priority=3,
    )


def step(epoch: int, event: str, at_ns: int, block: str = "", text: str = "") -> MissionProgress:
    return MissionProgress("formation", epoch, block, "Mission", event, at_ns, text)


def disk(data: Path, kept: int = 200) -> RunDisk:
    return RunDisk("uav1", data, kept)


def play(found: RunDisk, epoch: int, mission: str = "formation") -> None:
    found.begin(order(epoch, mission), "ann@gcs", (), epoch, UTC_NS)
    found.add([step(epoch, "state:ready", epoch), step(epoch, "state:done", epoch + 1)], UTC_NS)


def test_run_has_mission_progress_findings_and_outcome(tmp_path: Path) -> None:
    segments = tmp_path / "log"
    segments.mkdir()
    for number in (1, 2):
        (segments / f"{number:08d}.mcap").touch()
    found = disk(tmp_path)
    found.begin(order(7), "ann@gcs", (WARNING,), 10, UTC_NS)
    found.add([step(7, "state:running", 20), step(7, "started", 30, "b1")], UTC_NS)
    assert [(one.epoch, one.outcome, one.folder) for one in found.history().runs] == [(7, "open", NAME)]
    (segments / "00000003.mcap").touch()
    found.add([step(7, "state:failed", 40, text="blocked"), step(7, "state:recovering", 50)], UTC_NS)
    run = found.details(7)
    record = run.record
    assert run.document == (tmp_path / "missions" / NAME / "document.json").read_text() == order(7).text
    assert (record.hash, record.params, record.members) == (order(7).hash, order(7).params, order(7).members)
    assert (record.ordered_by, record.issuer, record.findings) == ("ann@gcs", "gcs", (str(WARNING),))
    assert (record.outcome, record.reason, record.steps) == ("failed", "blocked", 3)
    assert [each.at_ns for each in run.progress] == [20, 30, 40], "what follows the end is not of the run"
    assert (record.log.first_ns, record.log.last_ns) == (10, 40)
    assert (record.log.first_utc_ns, record.log.last_utc_ns) == (UTC_NS + 10, UTC_NS + 40)
    assert record.log.segments == ("00000002.mcap", "00000003.mcap")


def test_next_daemon_continues_or_reports_interrupted_run(tmp_path: Path) -> None:
    first = disk(tmp_path)
    first.begin(order(7), "ann@gcs", (), 10, UTC_NS)
    first.begin(order(8, "../other"), "ann@gcs", (), 10, UTC_NS)
    first.add([step(7, "state:running", 20)], UTC_NS)
    second = disk(tmp_path)
    assert {one.outcome for one in second.history().runs} == {"interrupted"}
    second.add([step(7, "resumed", 30, "b1"), step(7, "state:done", 40)], UTC_NS)
    assert [(one.epoch, one.outcome, one.folder) for one in second.history().runs] == [
        (7, "done", NAME),
        (8, "interrupted", "20260921T141320Z-.._other"),
    ]
    assert second.details(7).record.steps == 3


def test_newest_runs_are_kept_and_open_ones(tmp_path: Path) -> None:
    stored = tmp_path / "missions" / "patrol"
    stored.mkdir(parents=True)
    found = disk(tmp_path, kept=2)
    found.begin(order(1), "", (), 1, UTC_NS)
    for epoch in range(2, 6):
        play(found, epoch)
    assert [one.epoch for one in found.history().runs] == [5, 1]
    assert stored.is_dir(), "a stored mission is no run"
    with pytest.raises(NotFound, match="uav1: no run 2;"):
        found.details(2)


def test_unwritable_disk_is_counted_with_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "missions").write_text("a file where a folder is expected")
    found = disk(tmp_path)
    with caplog.at_level(logging.WARNING, "swarm.mission"):
        play(found, 7)
    history = found.history()
    assert (history.runs, history.failed_writes) == ((), 4)
    assert "missions" in history.failure
    assert len(caplog.records) == 1


def test_run_is_recorded_once_disk_has_room(tmp_path: Path) -> None:
    obstacle = tmp_path / "missions"
    obstacle.write_text("")
    found = disk(tmp_path)
    found.begin(order(7), "ann@gcs", (), 10, UTC_NS)
    obstacle.unlink()
    found.add([step(7, "state:running", 20), step(7, "state:done", 30)], UTC_NS)
    assert [(one.epoch, one.outcome) for one in found.history().runs] == [(7, "done")]
    assert found.details(7).document == order(7).text


def test_progress_has_maximum_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_folder, "PROGRESS_MAX_BYTES", 1000)
    found = disk(tmp_path)
    found.begin(order(7), "", (), 10, UTC_NS)
    found.add([step(7, "started", 20 + number, "b1") for number in range(50)], UTC_NS)
    found.add([step(7, "state:done", 99)], UTC_NS)
    record = found.details(7).record
    assert record.steps + record.left_out == 51 and record.steps < 12
    assert (tmp_path / "missions" / NAME / "progress.jsonl").stat().st_size <= 1000


def test_damaged_files_hide_no_other_run(tmp_path: Path) -> None:
    found = disk(tmp_path)
    for epoch in (1, 2, 3):
        play(found, epoch)
    folders = sorted((tmp_path / "missions").iterdir())
    (folders[0] / "run.json").write_bytes(b"")
    (folders[1] / "progress.jsonl").write_bytes(b'{"mission": ')
    (folders[1] / "document.json").unlink()
    assert len(found.history().runs) == 2
    epoch = found.history().runs[1].epoch
    assert (found.details(epoch).progress, found.details(epoch).document) == ((), "")
