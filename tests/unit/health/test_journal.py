"""The monitor's journal, from which it restores its state after a kill."""

import errno
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.health.journal import Journal, JournalFile
from swarmware.types.health import CheckRegistration, Fault, Phase

REGISTRATION = CheckRegistration("planner/path", "planner#1", 2.0)
FAULT = Fault("battery", "low", "warn", Phase.CONFIRMED, 1, 2, 3, "0.29")


def test_journal_loads_in_same_node_start_only(tmp_path: Path) -> None:
    journal = JournalFile(tmp_path / "health", 5)
    assert journal.load() == Journal(5)
    journal.save((REGISTRATION,), (FAULT,))
    assert JournalFile(tmp_path / "health", 5).load() == Journal(5, (REGISTRATION,), (FAULT,))
    assert JournalFile(tmp_path / "health", 6).load() == Journal(6)
    assert [path.name for path in (tmp_path / "health").iterdir()] == ["journal.json"]


def test_full_disk_keeps_former_journal_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = JournalFile(tmp_path / "health", 5)
    journal.save((REGISTRATION,), (FAULT,))

    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", no_room)
        with pytest.raises(OSError, match="No space"):
            journal.save((), ())
        patch.setattr(Path, "mkdir", no_room)
        assert JournalFile(tmp_path / "elsewhere", 5).load() == Journal(5), "a monitor starts without room"
    assert journal.load() == Journal(5, (REGISTRATION,), (FAULT,))
    assert [path.name for path in (tmp_path / "health").iterdir()] == ["journal.json"]


def test_a_damaged_journal_is_an_empty_one(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("journal")

    @given(st.binary(max_size=100))
    def check(data: bytes) -> None:
        journal = JournalFile(folder, 5)
        (folder / "journal.json").write_bytes(data)
        assert journal.load() == Journal(5)

    check()
