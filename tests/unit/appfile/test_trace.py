"""Died or left: what the file of an application says after its end."""

import fcntl
import os
from pathlib import Path

from swarmware.service.starting import spawn_missing, starting_pid, write_start_record
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.appfile.trace import died, last_of, set_aside


def join(run_dir: Path, name: str = "guard") -> AppFile:
    return AppFile(run_dir, name, endpoint="ipc:///tmp/x", started_ns=1)


def end_of_process(app: AppFile) -> None:
    os.close(app._fd)  # what the kernel does, whatever else was to be done


def test_one_that_takes_its_file_away_has_left(tmp_path: Path) -> None:
    app = join(tmp_path)
    assert not died(tmp_path, app.entry)
    app.close()
    assert not died(tmp_path, app.entry)
    assert last_of(tmp_path, "guard") is None


def test_process_died_before_and_after_master_tidied(tmp_path: Path) -> None:
    app = join(tmp_path)
    end_of_process(app)
    assert died(tmp_path, app.entry)
    set_aside(app.path)
    assert died(tmp_path, app.entry)
    assert last_of(tmp_path, "guard") == app.entry
    table = AppTable(tmp_path)
    table.refresh(probe=True)
    assert list(table) == []


def test_the_next_of_the_name_removes_the_trace(tmp_path: Path) -> None:
    app = join(tmp_path)
    end_of_process(app)
    set_aside(app.path)
    again = join(tmp_path)
    assert last_of(tmp_path, "guard") is None
    again.close()
    assert list((tmp_path / "apps").iterdir()) == []


def test_running_or_starting_process_is_not_started_again(tmp_path: Path) -> None:
    app = join(tmp_path)
    assert spawn_missing("guard", tmp_path, tmp_path) is None
    app.close()
    write_start_record("guard", os.getpid(), tmp_path)
    assert starting_pid("guard", tmp_path) == os.getpid()
    assert spawn_missing("guard", tmp_path, tmp_path) is None


def test_unreadable_file_of_application_hides_no_others(tmp_path: Path) -> None:
    app = join(tmp_path)
    nested = tmp_path / "apps" / "planner#1.toml"
    with nested.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        held.write("config = " + "[" * 5000 + "]" * 5000)
        held.flush()
        table = AppTable(tmp_path)
        table.refresh(probe=True)
        assert [entry.name for entry in table] == ["guard"]
    app.close()
