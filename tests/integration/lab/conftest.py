"""A folder of labs of the test's own, and the command as an operator types it."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState
from swarmlab.provision import provisioning
from swarmlab.radio.namespace import check_rights
from swarmware.errors import Denied

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]


@pytest.fixture(scope="session")
def rights() -> None:
    try:
        check_rights()
    except Denied as error:
        pytest.skip(str(error))


@pytest.fixture
def labs_folder() -> Iterator[Path]:
    with folder_of_labs() as folder:
        yield folder


@pytest.fixture
def ctl(labs_folder: Path) -> Ctl:
    return command(labs_folder)


@contextmanager
def folder_of_labs() -> Iterator[Path]:
    """Folder of labs; short, because sockets live below it. Whatever a test leaves there is ended."""
    folder = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARMCTL_LABS", str(folder))
        try:
            yield folder
        finally:
            for lab in labs.labs():
                provisioning.down(lab)
            shutil.rmtree(folder)


def command(labs_folder: Path) -> Ctl:
    """`swarmctl …`, to its end."""

    def run(*words: str, code: int | None = 0) -> Done:
        done = subprocess.run(
            [sys.executable, "-m", "swarmctl", *words],
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            # the computer may be busy with other labs
            env={**os.environ, "SWARMCTL_LABS": str(labs_folder), "SWARMCTL_TIMEOUT": "20"},
        )
        assert code is None or done.returncode == code, (
            f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
        )
        return done

    return run


def remains(lab: LabState) -> list[str]:
    """What a lab that was taken down left behind."""
    left = [str(process.pid) for process in processes.marked(lab.mark)]
    left += [node.shm_dir for node in lab.nodes if Path(node.shm_dir).exists()]
    left += [node.folder for node in lab.nodes if Path(node.folder).exists()]
    return left


@pytest.fixture
def nothing_remains() -> Callable[[LabState], None]:
    """Asserts that a lab is gone without a trace."""

    def check(lab: LabState) -> None:
        assert remains(lab) == []
        assert not Path(lab.folder).exists()

    return check
