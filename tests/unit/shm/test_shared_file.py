"""Files of folders that others may write: opened at once or refused, and removed whatever they are."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.unit.shm.folders import folder, full_folder, link, listener

from swarmware.errors import WireError
from swarmware.transport.shm.shared_file import discard, kind_at, open_cleared, open_shared

LIMIT = 1000


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(4 << 30)


HOSTILE: list[tuple[Callable[[Path], None], str]] = [
    (os.mkfifo, "a FIFO; expected a regular file"),
    (folder, "a folder; expected a regular file"),
    (full_folder, "a folder; expected a regular file"),
    (link, "a symbolic link; expected a regular file"),
    (listener, "a socket; expected a regular file"),
    (sparse, f"{4 << 30} bytes; expected at most {LIMIT}"),
]


@pytest.mark.parametrize(("make", "reason"), HOSTILE)
@pytest.mark.parametrize("flags", [os.O_RDONLY, os.O_RDWR, os.O_WRONLY])
def test_unsuitable_file_is_refused_at_once(
    tmp_path: Path, make: Callable[[Path], None], reason: str, flags: int
) -> None:
    path = tmp_path / "x"
    make(path)
    with pytest.raises(WireError) as refused:
        open_shared(path, flags, limit_bytes=LIMIT)
    assert str(refused.value) == f"{path}: {reason}"


@pytest.mark.parametrize("make", [make for make, _ in HOSTILE])
def test_what_lies_at_a_path_is_cleared_away(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "x"
    make(path)
    assert discard(path)
    assert kind_at(path) == "no file"
    assert discard(path), "there is nothing already"
    assert Path("/etc/passwd").exists()


def test_folder_with_content_keeps_it_under_another_name(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    full_folder(path)
    assert discard(path)
    kept = next(tmp_path.iterdir())
    assert kept.suffix == ".refused"
    assert (kept / "inner").is_dir()
    assert not discard(kept), "it is out of the way already"


@pytest.mark.parametrize("make", [make for make, _ in HOSTILE[:-1]])
def test_own_file_takes_place_of_anything_else(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "x"
    make(path)
    fd = open_cleared(path, os.O_RDWR | os.O_CREAT)
    os.write(fd, b"ours")
    os.close(fd)
    assert path.read_bytes() == b"ours"


def test_missing_file_is_missing_small_file_opens(tmp_path: Path) -> None:
    path = tmp_path / "x"
    with pytest.raises(FileNotFoundError):
        open_shared(path)
    path.write_bytes(bytes(LIMIT))
    fd = open_shared(path, limit_bytes=LIMIT)
    assert not os.get_inheritable(fd)
    os.close(fd)
