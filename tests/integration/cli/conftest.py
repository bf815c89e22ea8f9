"""One lab for all commands, started and ended by the public door, and `swarmctl` as an operator types it."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import command_schemas
import jsonschema
import pytest
from tests.integration.cli.terminal import Terminal
from tests.patience import PATIENCE_S

from swarmctl import main as swarmctl
from swarmctl.session import processes

NODES = ("gcs", "uav1", "uav2", "ugv1")
ANSWER_S: Final = 20.0
"""For which a command waits for an answer: the computer may be busy with other labs."""


class Done(NamedTuple):
    """What a command left."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON document on stdout."""
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found

    @property
    def lines(self) -> list[dict[str, Any]]:
        """JSON Lines on stdout."""
        return [json.loads(line) for line in self.out.splitlines()]


Ctl = Callable[..., Done]


class Lab(NamedTuple):
    """The lab and the environment in which commands find it."""

    name: str
    folder: Path
    env: dict[str, str]

    def ctl(self, command: str, timeout_s: float = 2 * PATIENCE_S) -> Done:
        """`swarmctl …` to its end; words as a shell would split them."""
        done = subprocess.run(
            self.words(command),
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            env=self.env,
            timeout=timeout_s,
        )
        assert "Traceback" not in done.stderr, done.stderr
        return Done(done.returncode, done.stdout, done.stderr)

    def started(self, command: str) -> "subprocess.Popen[str]":
        """`swarmctl …`, still running."""
        return subprocess.Popen(
            self.words(command), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.env
        )

    def words(self, command: str) -> list[str]:
        return [sys.executable, "-m", "swarmctl", *shlex.split(command)]

    def up(self) -> None:
        """Start the lab under its name, without packages of an earlier lab."""
        shutil.rmtree(self.packages, ignore_errors=True)
        self.packages.mkdir()  # before an interpreter caches that the folder is missing
        done = self.ctl(f"lab up formation --nodes {len(NODES)} --name {self.name} --detach")
        assert done.code == 0, done.err
        end_s = time.monotonic() + PATIENCE_S
        while not self.known():
            assert time.monotonic() < end_s, "the registers do not agree"

    def known(self) -> bool:
        """Whether the ground station has the applications of all nodes, which arrive after their trees."""
        units = self.ctl("app ls --all --json").document["units"]
        names = [{app["name"] for app in unit["table"]["applications"]} for unit in units]
        return len(units) == len(NODES) and all({"broker", "tree"} <= known for known in names)

    def down(self) -> None:
        """End the lab, and check that it leaves no shared memory."""
        done = self.ctl(f"lab down {self.name}")
        assert done.code == 0, done.err
        assert list(Path("/dev/shm").glob(f"*-{self.name}-*")) == []

    @property
    def packages(self) -> Path:
        """Of drivers and services that a test installs."""
        return self.folder / "packages"

    def node(self, platform: str) -> dict[str, Any]:
        """What lab.json says of a node."""
        record = json.loads((self.folder / self.name / "lab.json").read_text())
        return next(dict(node) for node in record["nodes"] if node["platform"] == platform)

    def signal(self, platform: str, number: signal.Signals) -> None:
        """To all processes of a node: its parent, which would start it again, and its daemons."""
        found = processes.marked(self.node(platform)["folder"], processes.NODE_MARK)
        assert found
        for process in found:
            process.send(number)

    @contextmanager
    def killed(self, platform: str) -> Iterator[None]:
        """SIGKILL to the daemons of a node; its parent is stopped and starts them again at the end."""
        node = self.node(platform)
        parent = processes.identity(node["pid"])
        parent.send(signal.SIGSTOP)
        daemons = [p for p in processes.marked(node["folder"], processes.NODE_MARK) if p != parent]
        try:
            assert daemons
            for process in daemons:
                process.send(signal.SIGKILL)
            yield
            assert not any(process.alive() for process in daemons)
        finally:
            parent.send(signal.SIGCONT)


FAILED: Final = pytest.StashKey[bool]()
"""Of a test: it failed, at whatever step."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Notes a failure, for the fixtures that clean up after it."""
    report = yield
    item.stash[FAILED] = item.stash.get(FAILED, False) or report.failed
    return report


@pytest.fixture(scope="session")
def shared_lab() -> Iterator[Lab]:
    """Four nodes in their own folder of labs, which is removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    kept = {key: value for key, value in os.environ.items() if not key.startswith("SWARMCTL_")}
    env = {
        **kept,
        "SWARMCTL_LABS": str(folder),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "NO_COLOR": "1",
        "SWARMCTL_TIMEOUT": str(ANSWER_S),
    }
    found = Lab(f"cli{os.getpid()}", folder, env)
    env["PYTHONPATH"] = str(found.packages)
    try:
        found.up()
        yield found
    finally:
        try:
            found.down()
        finally:
            shutil.rmtree(folder)


@pytest.fixture
def lab(shared_lab: Lab, request: pytest.FixtureRequest) -> Iterator[Lab]:
    """The lab of all tests here; a test that fails leaves a vehicle in the air or a limit: a new one then."""
    yield shared_lab
    if request.node.stash.get(FAILED, False):
        shared_lab.down()
        shared_lab.up()


@pytest.fixture
def ctl(lab: Lab, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Ctl:
    """`swarmctl …` in this process: ten times faster, and what it leaves open is a failure."""
    for name in [key for key in os.environ if key.startswith("SWARMCTL_")]:
        monkeypatch.delenv(name)
    for name in ("SWARMCTL_LABS", "SWARMCTL_TIMEOUT", "XDG_CACHE_HOME", "NO_COLOR"):
        monkeypatch.setenv(name, lab.env[name])

    def run(command: str) -> Done:
        capsys.readouterr()
        with Path(os.devnull).open() as nobody, monkeypatch.context() as patch:
            patch.setattr(sys, "stdin", nobody)
            code = swarmctl.main(shlex.split(command))
        done = Done(code, *capsys.readouterr())
        _validate(shlex.split(command), done.out)
        return done

    return run


@pytest.fixture
def environment(lab: Lab) -> dict[str, str]:
    """The environment of a reader: Swarmware is installed there, it is active, and a lab runs.

    What `pip` installs, without a network, the lab finds, and it is removed with the lab.
    """
    here = Path(sys.executable).parent
    pip = {"DISABLE_PIP_VERSION_CHECK": "1", "NO_BUILD_ISOLATION": "0", "NO_COMPILE": "0", "NO_DEPS": "1"}
    pip |= {"NO_INDEX": "1", "ROOT_USER_ACTION": "ignore", "TARGET": lab.env["PYTHONPATH"]}
    return {
        **lab.env,
        **{f"PIP_{name}": value for name, value in pip.items()},
        "PATH": f"{here}{os.pathsep}{os.environ['PATH']}",
    }


@pytest.fixture
def terminal(environment: dict[str, str], tmp_path: Path) -> Iterator[Terminal]:
    """The shell of a reader, in a short folder: nodes that a page starts have sockets below it."""
    home = Path(tempfile.mkdtemp(prefix="sw", dir="/tmp"))
    found = Terminal(home, tmp_path, environment)
    try:
        yield found
    finally:
        found.close()
        shutil.rmtree(home)


def _validate(words: list[str], out: str) -> None:
    """Each document matches the shipped schema of its command."""
    if "--json" not in words or not out:
        return
    commands = [*(" ".join(pair) for pair in pairwise(words)), *words]
    command = next((one for one in commands if one in command_schemas.DOCUMENTS), None)
    assert command, f"{words}: no schema"
    found = json.loads(out) if out.startswith("{\n") else None
    if command == "tree get" and found and "values" in found:
        command = "tree get PATTERN"
    if command == "mission history" and "--show" in words:
        command = "mission history ID"
    if command == "mission start" and found is None:
        command = "mission watch"
    if found and "result" in (found.get("nodes") or [{}])[0]:
        jsonschema.validate(found, command_schemas.schema("nodes"))
        for node in found["nodes"]:
            if node["result"] is not None:
                whole = {"schema_version": found["schema_version"], **node["result"]}
                jsonschema.validate(whole, command_schemas.schema(command))
        return
    for one in [found] if found else [json.loads(line) for line in out.splitlines()]:
        jsonschema.validate(one, command_schemas.schema(command))
