"""Starts of service processes: start records, environment, and the fork server."""

import os
import select
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarmware.service import fork_client, starting
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import FOLDER, SOCKET, StartedProcess, own_folder, request_fork
from swarmware.service.starting import (
    GUARD,
    PARENT_SOCKET,
    STARTING_DIR,
    clear_start_record,
    environment,
    spawn_missing,
    starting_pid,
    write_start_record,
)

Answer = Callable[[socket.socket, list[str]], object]


@contextmanager
def server(run_dir: Path, answer: Answer) -> Iterator[None]:
    """A fork server for one request."""
    path = Path(own_folder(run_dir, FOLDER)) / SOCKET
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listening.bind(str(path))
    listening.listen()

    def serve() -> None:
        asked, _ = listening.accept()
        with asked:
            answer(asked, asked.recv(4096).decode().split("\0"))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        thread.join(20.0)
        listening.close()


# -- start records


def test_start_record_names_process_until_it_is_cleared(tmp_path: Path) -> None:
    assert starting_pid("hal", tmp_path) == 0
    write_start_record("hal", os.getpid(), tmp_path)
    assert starting_pid("hal", tmp_path) == os.getpid()
    assert starting_pid("sim", tmp_path) == 0
    clear_start_record("hal", tmp_path)
    clear_start_record("hal", tmp_path)
    assert starting_pid("hal", tmp_path) == 0


@pytest.mark.parametrize(
    "text",
    ["", "7", "x y", "{pid} 1", "4194305 0", "1 2 3", "no\x00number", "{pid}", "{pid} -1", "{pid} {pid}"],
)
def test_foreign_or_damaged_start_record_is_ignored(tmp_path: Path, text: str) -> None:
    (Path(own_folder(tmp_path, STARTING_DIR)) / "hal").write_text(text.format(pid=os.getpid()))
    assert starting_pid("hal", tmp_path) == 0


def test_folder_of_node_is_closed_to_other_users(tmp_path: Path) -> None:
    folder = Path(own_folder(tmp_path / "run", "parent"))
    assert folder == tmp_path / "run/parent"
    assert [path.stat().st_mode & 0o777 for path in (folder, folder.parent)] == [0o700, 0o700]
    assert own_folder(tmp_path / "run", "parent") == str(folder), "it may be there already"


# -- environment


@pytest.mark.parametrize("notifies", [False, True])
@pytest.mark.parametrize("parent", [False, True])
def test_new_process_inherits_environment_without_service_manager(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, notifies: bool, parent: bool
) -> None:
    monkeypatch.setenv("SWARM_PROBE", "kept")
    for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID", "MAINPID"):
        monkeypatch.setenv(name, "of our own manager")
    if parent:
        (Path(own_folder(tmp_path, FOLDER)) / PARENT_SOCKET).touch()
    variables = environment(tmp_path, notifies=notifies)
    assert variables["SWARM_PROBE"] == "kept"
    assert not {"WATCHDOG_PID", "MAINPID"} & variables.keys()
    if parent and notifies:
        assert variables["NOTIFY_SOCKET"] == str(tmp_path / FOLDER / PARENT_SOCKET)
        assert variables["WATCHDOG_USEC"] == "4000000"
    else:
        assert not {"NOTIFY_SOCKET", "WATCHDOG_USEC"} & variables.keys()


# -- the fork server


def test_request_names_services_and_its_answer_process(tmp_path: Path) -> None:
    asked: list[list[str]] = []

    def answer(asking: socket.socket, words: list[str]) -> None:
        asked.append(words)
        asking.send(b"4711")
        asking.send(b"exit 3")

    with server(tmp_path, answer):
        started = request_fork(["hal", "sim"], "/etc/swarm", tmp_path, {"HOME": "/", "MARK": "a=b"})
        assert started is not None
        assert started.pid == 4711
        assert started.exit_status(10.0) == ExitStatus(code=3)
        started.close()
        started.close()
    assert asked == [["/etc/swarm", str(Path.cwd()), "2", "hal", "sim", "HOME=/", "MARK=a=b"]]


REFUSALS: dict[str, Answer] = {
    "it ends without an answer": lambda asking, _: None,
    "it has no process": lambda asking, _: asking.send(b"0"),
    "it answers something else": lambda asking, _: asking.send(b"no\xff"),
}


@pytest.mark.parametrize("answer", REFUSALS.values(), ids=REFUSALS)
def test_missing_fork_server_process_is_reported(tmp_path: Path, answer: Answer) -> None:
    with server(tmp_path, answer):
        assert request_fork(["hal"], "/etc/swarm", tmp_path, {}) is None


def test_without_a_fork_server_there_is_none(tmp_path: Path) -> None:
    assert request_fork(["hal"], "/etc/swarm", tmp_path, {}) is None


def test_request_that_is_too_long_is_not_sent(tmp_path: Path) -> None:
    asked: list[list[str]] = []
    variables = {"LONG": "x" * fork_client.REQUEST_BYTES}
    with server(tmp_path, lambda _, words: asked.append(words)):
        assert request_fork(["hal"], "/etc/swarm", tmp_path, variables) is None
    assert asked == [[""]], "the connection was closed"


def test_shared_fork_server_is_asked_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = tmp_path / "shared"
    monkeypatch.setenv(fork_client.VARIABLE, str(shared / FOLDER / SOCKET))
    with server(shared, lambda asking, _: asking.send(b"4711")):
        started = request_fork(["hal"], "/etc/swarm", tmp_path, {})
        assert started is not None
        started.close()


def test_a_fork_server_that_hangs_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path(own_folder(tmp_path, FOLDER)) / SOCKET
    code = (
        "import socket, sys; s = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET);"
        " s.bind(sys.argv[1]); s.listen(); print(flush=True); c = s.accept()[0]; c.recv(99); input()"
    )
    reading, writing = os.pipe()
    waits, never = os.pipe()
    pid = os.posix_spawn(
        sys.executable,
        [sys.executable, "-c", code, str(path)],
        os.environ,
        file_actions=[(os.POSIX_SPAWN_DUP2, writing, 1), (os.POSIX_SPAWN_DUP2, waits, 0)],
    )
    assert select.select([reading], [], [], 20.0)[0], "it listens"
    monkeypatch.setattr(fork_client, "ANSWER_S", 0.05)
    assert request_fork(["hal"], "/etc/swarm", tmp_path, {}) is None
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == -signal.SIGKILL
    for fd in (reading, writing, waits, never):
        os.close(fd)


def test_exit_status_is_unknown_without_fork_server(tmp_path: Path) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    started = StartedProcess(4711, ours)
    assert started.exit_status() == ExitStatus(), "no answer yet"
    theirs.close()
    assert started.exit_status(5.0) == ExitStatus()
    started.close()
    assert StartedProcess(1).exit_status() == ExitStatus(), "a child of somebody else"


# -- one start among many


def test_a_service_is_started_once_whoever_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    launched: list[tuple[list[str], bool]] = []

    def launch(names: list[str], config_dir: object, run_dir: object, *, notifies: bool) -> StartedProcess:
        launched.append((names, notifies))
        return StartedProcess(os.getpid())

    monkeypatch.setattr(starting, "launch", launch)
    first = spawn_missing(GUARD, "/etc/swarm", tmp_path)
    assert first is not None
    assert spawn_missing(GUARD, "/etc/swarm", tmp_path) is None, "it is being started"
    assert launched == [([GUARD], True)], "the guard notifies the parent"
    assert starting_pid(GUARD, tmp_path) == first.pid
    assert spawn_missing("hal", "/etc/swarm", tmp_path) is not None
    assert launched[1:] == [(["hal"], False)]
