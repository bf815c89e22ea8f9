"""The parent of a node receives notifications although its files are removed, and stays the only one."""

import shutil
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

from swarmd.parent_socket import ParentSocket
from swarmware.errors import Conflict
from swarmware.service.notify import Notifier


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture
def receiver(run_dir: Path) -> Iterator[ParentSocket]:
    with closing(ParentSocket(str(run_dir))) as made:
        yield made


def received(receiver: ParentSocket) -> dict[str, str]:
    with closing(Notifier(receiver.address, "")) as notifier:
        notifier.status("here")
    found = receiver.receive()
    return {} if found is None else found[1]


def test_a_socket_that_stands_is_left_alone(receiver: ParentSocket) -> None:
    fd = receiver.fileno()
    assert not receiver.restore()
    assert receiver.fileno() == fd
    assert received(receiver) == {"STATUS": "here"}


@pytest.mark.parametrize("what", ["run/parent/notify", "run/parent"])
def test_removed_file_is_recreated_under_lock(tmp_path: Path, receiver: ParentSocket, what: str) -> None:
    path = tmp_path / what
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
    assert received(receiver) == {}
    assert receiver.restore()
    assert received(receiver) == {"STATUS": "here"}
    assert not receiver.restore()
    with pytest.raises(Conflict, match="runs here already"):
        ParentSocket(str(tmp_path / "run"))


def test_run_directory_is_made_by_node_process(run_dir: Path, receiver: ParentSocket) -> None:
    shutil.rmtree(run_dir)
    assert not receiver.restore()
    assert not run_dir.exists()
    run_dir.mkdir(mode=0o750)
    assert receiver.restore()
    assert run_dir.stat().st_mode & 0o777 == 0o750


def test_second_parent_keeps_recreated_folder(run_dir: Path, receiver: ParentSocket) -> None:
    shutil.rmtree(run_dir / "parent")
    with closing(ParentSocket(str(run_dir))), pytest.raises(Conflict):
        receiver.restore()
    with suppress(FileNotFoundError):
        assert receiver.restore()
