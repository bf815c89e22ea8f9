"""The parent of a node and its fork server: killed, hung, replaced, while the daemons go on."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

import pytest
from tests.patience import PATIENCE_S, until, until_answer

from swarmware.errors import NoAnswer, SwarmError
from swarmware.module.module import Module
from swarmware.runtime.pidfd import start_ticks
from swarmware.service import fork_client
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import FOLDER, SOCKET, VARIABLE, request_fork
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import Process, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan
from swarmware.types.health import FaultList, FaultQuery, Phase

T = TypeVar("T")
SERVICES = ("register", "timesync", "guard", "health")


def daemons(root: Path) -> dict[str, int]:
    return {entry.name: entry.pid for entry in scan(root / "uav1/run")}


def complete(root: Path) -> dict[str, int]:
    """All daemons by name, when all are there."""
    found = daemons(root)
    return found if found.keys() == set(SERVICES) else {}


def another(root: Path, dead: int) -> int:
    """Process of the guard, when it is not this one."""
    pid = daemons(root).get("guard", dead)
    return 0 if pid == dead else pid


def said(process: Process, text: str) -> bool:
    return text in process.stderr()


def command(pid: int) -> list[str]:
    try:
        line = Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
        return []
    return line.rstrip(b"\0").decode().split("\0")


def family(pid: int) -> tuple[int, int]:
    """Parent and session."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[1]), int(fields[3])


def standard_input(pid: int) -> str:
    return str(Path(f"/proc/{pid}/fd/0").readlink())


def fork_server(parent: int) -> int:
    """Process id of the fork server among the children of the parent, or 0 while there is no such child."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    found = [int(pid) for pid in children if command(int(pid))[3:4] == ["forkserver"]]
    return found[0] if found else 0


@asynccontextmanager
async def node(
    root: Path, processes: str = "per-daemon", *, fork_server: bool = False
) -> AsyncIterator[tuple[Path, Process]]:
    services: dict[str, dict[str, int]] = {name: {} for name in SERVICES}
    config = make_node(root, services=services, processes=processes, fork_server=fork_server)
    with no_leaks(root / "uav1/run", root / "uav1/shm"):
        async with spawn(config) as parent:
            await until(lambda: complete(root), "daemons")
            yield config, parent


async def test_forked_daemons_look_like_freshly_started_ones(tmp_path: Path) -> None:
    async with node(tmp_path) as (config, parent):
        server = fork_server(parent.pid)
        for name, pid in daemons(tmp_path).items():
            assert command(pid) == [sys.executable, "-m", "swarmd", "run", name, "--config", str(config)]
            assert family(pid) == (server, pid), "a child of the server, in a session of its own"
            assert standard_input(pid) == "/dev/null"


async def test_killed_fork_server_is_replaced_and_daemons_live(tmp_path: Path) -> None:
    async with node(tmp_path) as (_, parent):
        before, server = daemons(tmp_path), fork_server(parent.pid)
        os.kill(server, signal.SIGKILL)
        after = await until(lambda: (pid := fork_server(parent.pid)) != server and pid, "another server")
        assert complete(tmp_path) == before
        await until((tmp_path / "uav1/run" / FOLDER / SOCKET).exists, "socket")
        os.kill(before["timesync"], signal.SIGKILL)
        await until(
            lambda: daemons(tmp_path).get("timesync", before["timesync"]) != before["timesync"], "timesync"
        )
        assert fork_server(parent.pid) == after


async def test_hanging_fork_server_does_not_delay_daemons(tmp_path: Path) -> None:
    async with node(tmp_path) as (_, parent):
        before, server = daemons(tmp_path), fork_server(parent.pid)
        os.kill(server, signal.SIGSTOP)
        os.kill(before["timesync"], signal.SIGKILL)
        await until(
            lambda: daemons(tmp_path).get("timesync", before["timesync"]) != before["timesync"], "timesync"
        )
        await until(lambda: fork_server(parent.pid) not in {0, server}, "another server")


async def test_everything_but_parent_killed_at_once_is_back(tmp_path: Path) -> None:
    async with node(tmp_path) as (_, parent):
        before = daemons(tmp_path)
        for pid in (fork_server(parent.pid), *before.values()):
            os.kill(pid, signal.SIGKILL)
        await until(
            lambda: (after := complete(tmp_path)) and not set(before.values()) & set(after.values()),
            "daemons",
        )


async def test_guard_that_daemon_restarted_ends_with_parent(tmp_path: Path) -> None:
    async with node(tmp_path) as (_, parent):
        before = daemons(tmp_path)
        parent.signal(signal.SIGSTOP)
        os.kill(before["guard"], signal.SIGKILL)
        await until(
            lambda: (after := complete(tmp_path)) and after["guard"] != before["guard"], "another guard"
        )
        parent.signal(signal.SIGTERM)
        parent.signal(signal.SIGCONT)
        await until(lambda: parent.returncode is not None, "its end")
        assert not daemons(tmp_path)


async def fault_of_supervision(module: Module) -> str:
    """Phase of the fault of an unsupervised node, or "" without this fault or without an answer yet."""
    with suppress(NoAnswer):
        found = await module.request("sys/health/faults", FaultQuery(cleared=True), FaultList)
        return next((one.phase for one in found.faults if one.check == "guard/supervisor"), "")
    return ""


async def until_phase(module: Module, phases: set[Phase]) -> None:
    await until_answer(lambda: fault_of_supervision(module), lambda phase: phase in phases)


@pytest.mark.parametrize("processes", ["one", "per-daemon"])
async def test_daemons_of_killed_parent_are_taken_over(tmp_path: Path, processes: str) -> None:
    async with node(tmp_path, processes) as (config, parent):
        before = daemons(tmp_path)
        server = fork_server(parent.pid)
        parent.signal(signal.SIGKILL)
        await until(lambda: parent.returncode is not None, "its end")
        assert complete(tmp_path) == before
        if server:
            await until(lambda: not start_ticks(server), "the end of the server, whose parent has gone")
        async with Module("probe", config_dir=config) as module:
            await until_phase(module, {Phase.CONFIRMED})
        assert complete(tmp_path) == before
        async with spawn(config) as successor:  # ready: it has a sign of life of what runs
            assert complete(tmp_path) == before
            async with Module("probe", config_dir=config) as module:
                await until_phase(module, {Phase.HEALED, Phase.CLEARED})
            assert await successor.terminate() == 0
            assert not any(start_ticks(pid) for pid in before.values())


@pytest.mark.parametrize("kept", [False, True])
async def test_one_process_for_all_services_is_forked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    async with node(tmp_path, "one", fork_server=kept) as (config, parent):
        server = fork_server(parent.pid)
        assert bool(server) is kept
        for number in (1, 2):
            before = daemons(tmp_path)["guard"]
            os.kill(before, signal.SIGKILL)
            after = await until(partial(another, tmp_path, before), "the next process")
            assert family(after) == (server if kept else parent.pid, after)
            assert command(after)[3:] == ["run", *SERVICES, "--config", str(config)]
            await until(partial(said, parent, f"signal 9; starts again (restart {number})"), "one restart")


async def test_second_parent_is_refused_while_first_lives(tmp_path: Path) -> None:
    async with node(tmp_path, "one") as (config, _):
        before = daemons(tmp_path)
        with pytest.raises(SwarmError, match=r"(?s)ended with 1 .*runs here already"):
            async with spawn(config):
                pass
        assert daemons(tmp_path) == before


async def test_unconfigurable_guard_ends_node_with_exit_code(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"guard": {}}, processes="per-daemon")
    (config / "services/guard.toml").write_text("hung_s = -1\n")
    with no_leaks(tmp_path / "uav1/run"), pytest.raises(SwarmError, match=r"(?s)ended with 7 .*hung_s"):
        async with spawn(config):
            pass


def test_fork_server_ends_with_its_parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fork_client, "ANSWER_S", PATIENCE_S)  # a busy computer forks late
    config = make_node(tmp_path, services={"timesync": {}}, processes="per-daemon")
    run_dir = tmp_path / "uav1/run"
    (run_dir / FOLDER).mkdir(parents=True)
    words = [sys.executable, "-m", "swarmd", "forkserver", "timesync"]
    words += ["--socket", str(run_dir / FOLDER / SOCKET)]
    with no_leaks(run_dir), subprocess.Popen(words, stdin=subprocess.PIPE) as server:
        assert server.stdin is not None
        asyncio.run(until((run_dir / FOLDER / SOCKET).exists, "socket"))
        os.kill(server.pid, signal.SIGSTOP)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as impatient:
            impatient.connect(str(run_dir / FOLDER / SOCKET))
            socket.send_fds(impatient, [f"{config}\0/\x001\0timesync".encode()], [1, 2, 2])
        os.kill(server.pid, signal.SIGCONT)
        # asked later, answered later: what comes before was looked at
        started = request_fork(["nosuch"], config, run_dir, dict(os.environ))
        assert started is not None
        assert started.exit_status(PATIENCE_S) == ExitStatus(code=6)
        started.close()
        assert not Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split()
        server.stdin.close()
        assert server.wait(PATIENCE_S) == 0


def test_shared_server_stays_until_its_last_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = make_node(tmp_path, services={"timesync": {}, "register": {}})
    path, run_dir = tmp_path / "shared", tmp_path / "uav1/run"
    monkeypatch.setenv(VARIABLE, str(path))
    monkeypatch.setattr(fork_client, "ANSWER_S", PATIENCE_S)  # a busy computer forks late
    words = [sys.executable, "-m", "swarmd", "forkserver", "timesync", "--socket", str(path), "--shared"]
    with no_leaks(), subprocess.Popen(words, stdin=subprocess.PIPE) as server:
        assert server.stdin is not None
        asyncio.run(until(path.exists, "socket"))
        while (first := request_fork(["timesync"], config, run_dir, dict(os.environ))) is None:
            assert server.poll() is None, "the socket is there a moment before it listens"
        server.stdin.close()
        second = request_fork(["nosuch"], config, run_dir, dict(os.environ))
        assert second is not None
        assert second.exit_status(PATIENCE_S) == ExitStatus(code=6)
        assert server.poll() is None
        os.kill(first.pid, signal.SIGKILL)
        assert first.exit_status(PATIENCE_S) == ExitStatus(signal=signal.SIGKILL)
        assert server.wait(PATIENCE_S) == 0
        for started in (first, second):
            started.close()
    assert not path.exists()
