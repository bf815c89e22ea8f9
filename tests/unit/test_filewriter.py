"""Replacing a file: whole or not at all, with its mode, and nothing left behind."""

import errno
import os
from pathlib import Path

import pytest

from swarmware.runtime.filewriter import replace_file, write_result


def test_file_is_replaced_with_mode_despite_umask(tmp_path: Path) -> None:
    path = tmp_path / "node.key"
    before = os.umask(0o077)
    try:
        replace_file(path, b"one", mode=0o644)
        assert (path.read_bytes(), path.stat().st_mode & 0o777) == (b"one", 0o644)
        replace_file(path, b"two", mode=0o600, durable=False)
    finally:
        os.umask(before)
    assert (path.read_bytes(), path.stat().st_mode & 0o777) == (b"two", 0o600)
    assert [file.name for file in tmp_path.iterdir()] == ["node.key"]


def test_former_file_is_readable_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "journal.json"
    replace_file(path, b"former")
    with path.open("rb") as file:
        replace_file(path, b"a longer content")
        assert file.read() == b"former"


@pytest.mark.parametrize(("where", "call"), [(os, "open"), (os, "fchmod"), (os, "fsync"), (Path, "replace")])
def test_full_disk_leaves_former_content_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: object, call: str
) -> None:
    path = tmp_path / "settings.toml"
    replace_file(path, b"former")

    def no_room(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(where, call, no_room)
        with pytest.raises(OSError, match="No space"):
            replace_file(path, b"new")
    assert path.read_bytes() == b"former"
    assert [file.name for file in tmp_path.iterdir()] == ["settings.toml"]


def test_link_at_unfinished_name_is_not_written_through(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_bytes(b"untouched")
    (tmp_path / f".roster.json.{os.getpid()}").symlink_to(victim)
    with pytest.raises(OSError, match="symbolic"):
        replace_file(tmp_path / "roster.json", b"new")
    assert victim.read_bytes() == b"untouched"


def test_named_device_is_written_and_stays_device(tmp_path: Path) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_result(fifo, b"poses")
        assert os.read(reader, 10) == b"poses"
        assert fifo.is_fifo()
    finally:
        os.close(reader)
    with pytest.raises(OSError, match="No space left") as full:
        write_result(Path("/dev/full"), b"x")
    assert full.value.filename == "/dev/full"
    write_result(tmp_path / "file", b"poses")
    assert (tmp_path / "file").read_bytes() == b"poses"
