"""A lab of somebody who is not root, has no home worth the name, and nothing to do with the installation."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from swarmctl.session import labs, processes
from swarmlab.provision import node_files

NOBODY = 65534
NAME = "k2user"


@pytest.fixture
def home() -> Iterator[Path]:
    """All that belongs to the user."""
    if os.getuid() != 0:
        pytest.skip("needs root, to become another user; as an ordinary one all other tests show the same")
    if shutil.which("setpriv") is None:
        pytest.skip("needs setpriv of util-linux")
    folder = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    os.chown(folder, NOBODY, NOBODY)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def as_nobody(home: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """A command of that user."""
    return subprocess.run(
        ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", *command],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        cwd=home,
        env={
            "PATH": os.environ["PATH"],
            "HOME": str(home),
            "SWARMCTL_LABS": str(home / "labs"),
            # the interpreter of this environment may lie in root's home; another one finds the same packages
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        },
    )


@pytest.fixture
def swarmctl(home: Path) -> Callable[..., str]:
    """`swarmctl …` of that user, to its end; what it says on standard output."""
    series = f"python{sys.version_info.major}.{sys.version_info.minor}"
    candidates = [
        sys.executable,
        *(found for at in ("/usr/bin", "/usr/local/bin") if (found := shutil.which(series, path=at))),
    ]
    probe = (
        "import subprocess, sys, swarmctl, swarmd, zmq; subprocess.run([sys.executable, '-V'], check=True)"
    )
    python = next((path for path in candidates if as_nobody(home, path, "-c", probe).returncode == 0), None)
    if python is None:
        pytest.skip(f"an ordinary user can run none of {', '.join(candidates)} with these packages")

    def run(*words: str) -> str:
        done = as_nobody(home, python, "-m", "swarmctl", *words)
        assert done.returncode == 0, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    return run


@pytest.mark.slow
@pytest.mark.root
def test_lab_of_ordinary_user_leaves_nothing(home: Path, swarmctl: Callable[..., str]) -> None:
    mark = str(home / "labs" / NAME)
    try:
        swarmctl("lab", "up", "formation", "--nodes", "3", "--per-daemon", "uav1", "--name", NAME, "--detach")
        running = processes.marked(mark)
        # each node has a parent; two have all services in one process, forked by the server of the lab, the
        # third has one each and a server of its own
        assert len(running) == 3 + 2 + len(node_files.VEHICLE) + 2
        assert {Path(f"/proc/{process.pid}").stat().st_uid for process in running} == {NOBODY}
        shared = [Path(node.shm_dir) for node in labs.load(Path(mark)).nodes]
        assert {path.stat().st_uid for path in shared} == {NOBODY}
        assert {path.stat().st_mode & 0o777 for path in shared} == {0o700}
        nodes = json.loads(swarmctl("node", "ls", "--json"))["nodes"]
        assert sorted(node["platform"] for node in nodes) == ["gcs", "uav1", "ugv1"]
        assert json.loads(swarmctl("tree", "get", "/uav1/nav/pose", "--json"))["quality"] == "live"
    finally:
        swarmctl("lab", "down", "--all")
    assert processes.marked(mark) == []
    assert not any(path.exists() for path in shared)
    assert list((home / "labs").iterdir()) == []
