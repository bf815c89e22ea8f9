"""Processes of services that tests start: forked, they end, fail and are left behind as others do."""

import asyncio
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import uvloop

from swarmware.errors import NoAnswer, SwarmError
from swarmware.runtime.pidfd import ProcessHandle, start_ticks
from swarmware.service.fork_client import request_fork_of
from swarmware.testing import forked
from swarmware.testing.forked import ForkServerProcess, fork_server, forking
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return make_node(tmp_path, services={"timesync": {}})


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServerProcess]:
    """The fork server of all tests."""
    found = fork_server(["timesync", "broker"])
    assert found is not None
    yield found
    assert fork_server(["timesync"]) is found, "every other one has ended"


def parent(pid: int) -> int | None:
    return psutil.Process(pid).ppid()


def test_service_is_forked_and_ends_in_good_order(
    tmp_path: Path, config: Path, server: ForkServerProcess
) -> None:
    async def run() -> None:
        async with spawn(config, "timesync") as process:
            assert parent(process.pid) == server.pid
            assert {entry.pid for entry in scan(tmp_path / "uav1/run")} == {process.pid}
            command = psutil.Process(process.pid).cmdline()
            assert command[1:7] == ["-m", "swarmd", "run", "timesync", "--config", str(config)]
            assert await process.terminate() == 0
            assert "timesync" in process.stderr(), "what it logs is read by the test"
            assert process.returncode == 0
            with pytest.raises(ProcessLookupError):
                process.signal(signal.SIGTERM)
            with pytest.raises(NoAnswer, match="ended"):
                await process.line()

    with no_leaks(tmp_path / "uav1/run"), asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(run())


async def test_concurrent_forks_have_own_output_and_exit_code(
    tmp_path: Path, config: Path, server: ForkServerProcess
) -> None:
    other = make_node(tmp_path, "uav2", services={"timesync": {}, "register": {}})
    with no_leaks():
        async with spawn(config, "timesync") as first, spawn(other, "timesync", "register") as second:
            await first.kill()
            assert first.returncode == -signal.SIGKILL
            assert second.returncode is None
            assert "uav1" in first.stderr()
            assert "uav1" not in second.stderr()
            os.kill(second.pid, signal.SIGTERM)  # by another one than the handle
            assert await second.wait() == 0


async def test_unconfigured_fork_names_exit_code_and_message(config: Path, server: ForkServerProcess) -> None:
    (config / "services/timesync.toml").write_text("nonsense = 1\n")
    with no_leaks(), pytest.raises(SwarmError, match=r"(?s)ended with 7 before it was ready.*nonsense"):
        async with spawn(config, "timesync"):
            pass


@pytest.mark.parametrize("how", ["told so", "a variable"])
async def test_start_test_uses_new_interpreter(config: Path, how: str) -> None:
    env = {"PYTHONPROFILEIMPORTTIME": "1"} if how == "a variable" else None
    async with spawn(config, "timesync", env=env, forked=how != "told so") as process:
        assert parent(process.pid) == os.getpid()
        assert ("import time" in process.stderr()) == (env is not None)


async def test_service_unknown_to_server_gets_new_interpreter(config: Path) -> None:
    with pytest.raises(SwarmError, match=r"(?s)ended with 6 .*not installed"):
        async with spawn(config, "nosuch"):
            pass


async def test_process_left_by_test_is_noticed(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forked, "LEFT_S", 0.1)
    pid = 0
    with pytest.raises(NoAnswer, match="left"), forking(["timesync"]) as own:
        with pytest.raises(AssertionError, match=r"left behind: \{'children'"), no_leaks():
            started = request_fork_of(
                own.socket, ["timesync"], config, dict(os.environ), shared=True, answer_s=60.0
            )
            assert started is not None
            pid = started.pid
            started.close()
        assert parent(pid) == own.pid
    assert not start_ticks(pid), "it was ended"


async def test_process_without_server_ends_others_start_anew(config: Path) -> None:
    with forking(["timesync"]) as own:
        async with spawn(config, "timesync") as process:
            assert parent(process.pid) == own.pid
            handle = ProcessHandle(own.pid)
            handle.signal(signal.SIGKILL)
            handle.close()
            assert await process.wait() == -signal.SIGKILL
        async with spawn(config, "timesync") as process:
            assert parent(process.pid) == os.getpid()


def test_server_that_ends_at_its_start_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with no_leaks(), pytest.raises(SwarmError, match="has ended"), forking(["timesync"]):
        pass
