"""A node of real processes under its guard: killed, hung and stopped, without leftovers."""

import asyncio
import fcntl
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests import patience
from tests.patience import PATIENCE_S

from swarmware.errors import NotFound, SwarmError
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.appfile.table import scan
from swarmware.types.health import (
    FaultList,
    FaultQuery,
    GuardStatus,
    HealthState,
    RestartOrder,
    WatchedService,
)
from swarmware.types.rpc import Empty
from swarmware.types.system import AppStatus

SERVICES: dict[str, Any] = {"register": {}, "timesync": {}, "health": {}, "guard": {}, "hal": {}, "sim": {}}


def pids(run_dir: Path) -> dict[str, int]:
    return {entry.name: entry.pid for entry in scan(run_dir)}


async def until(run_dir: Path, wanted: Any) -> dict[str, int]:
    """Applications of the node as soon as `wanted(pid by name)` is true."""
    return await patience.until(lambda: found if wanted(found := pids(run_dir)) else {})


async def back(run_dir: Path, name: str, old: int) -> float:
    """Seconds until another process has joined the node as this application."""
    began_s = time.monotonic()
    await until(run_dir, lambda found: found.get(name, old) != old)
    return time.monotonic() - began_s


@asynccontextmanager
async def guarded(root: Path, **services: Any) -> AsyncIterator[Path]:
    """A per-daemon node, all of its services running; stopped by SIGTERM to its guard.

    Yields: its configuration folder. Raises: AssertionError when something is left.
    """
    config = make_node(root, services=services or SERVICES, processes="per-daemon")
    run_dir = root / "uav1/run"
    with no_leaks(run_dir, root / "uav1/shm"):
        async with spawn(config):
            everybody: list[AppEntry] = []
            try:
                await until(run_dir, lambda found: found.keys() >= set(services or SERVICES))
                yield config
            finally:
                everybody = scan(run_dir)
                guard = next((entry for entry in everybody if entry.name == "guard"), None)
                if guard is not None:
                    os.kill(guard.pid, signal.SIGTERM)
                await patience.until(lambda: not any(entry.lives for entry in everybody))


async def test_twice_killed_guard_adopts_and_restarts_services(tmp_path: Path) -> None:
    run_dir = tmp_path / "uav1/run"
    async with guarded(tmp_path) as config:
        for _ in range(2):
            before = await until(run_dir, lambda found: found.keys() >= set(SERVICES))
            os.kill(before["guard"], signal.SIGKILL)
            await back(run_dir, "guard", before["guard"])
            after = pids(run_dir)
            assert {name: after[name] for name in SERVICES if name != "guard"} == {
                name: before[name] for name in SERVICES if name != "guard"
            }
        async with Module("probe", config_dir=config) as module:
            async with asyncio.timeout(PATIENCE_S):
                while not (await service(module, "timesync")).adopted:
                    pass
            os.kill(after["timesync"], signal.SIGKILL)
            await back(run_dir, "timesync", after["timesync"])
            timesync = await service(module, "timesync")
            assert timesync.restarts == 1
            assert timesync.reason in {"died", "died while no guard ran"}
            assert (await service(module, "sim")).adopted


async def service(module: Module, name: str) -> WatchedService:
    """Status of one service in the guard."""
    status = await asked(module, "sys/guard/status", Empty(), GuardStatus)
    found: WatchedService = next(one for one in status.services if one.name == name)
    return found


async def asked(module: Module, path: str, request: Any, reply: Any) -> Any:
    """The answer to a request, which is repeated until it is answered."""
    return await patience.until_answer(lambda: module.request(path, request, reply))


async def test_hanging_service_is_restarted_with_fault(tmp_path: Path) -> None:
    run_dir = tmp_path / "uav1/run"
    services = {"health": {"hung_s": 1.6}, "guard": {"hung_s": 3.0}, "timesync": {}}
    async with (
        guarded(tmp_path, **services) as config,
        Module("probe", config_dir=config) as module,
    ):
        board = module.reader("app/timesync/status", AppStatus)
        async with asyncio.timeout(PATIENCE_S):
            while board.value is None or board.value.beat < 3:
                await board.changed()
        old = pids(run_dir)["timesync"]
        os.kill(old, signal.SIGSTOP)
        await back(run_dir, "timesync", old)
        status = await asked(module, "sys/guard/status", Empty(), GuardStatus)
        assert next(one for one in status.services if one.name == "timesync").reason.startswith(
            "hung: no beat"
        )
        async with asyncio.timeout(PATIENCE_S):
            told: set[str] = set()
            while "app/timesync" not in told:
                faults = await asked(module, "sys/health/faults", FaultQuery(True), FaultList)
                told = {fault.check for fault in faults.faults}


async def test_locked_file_of_dead_service_is_not_alive(
    tmp_path: Path,
) -> None:
    run_dir = tmp_path / "uav1/run"
    async with (
        guarded(tmp_path, guard={}, timesync={}) as config,
        Module("probe", config_dir=config) as module,
    ):
        ended = module.stream_reader("guard/restarts", WatchedService)
        for number in (1, 2):  # the second comes right after the first, so there is a pause before the start
            old = pids(run_dir)["timesync"]
            with (run_dir / "apps/timesync#1.toml").open("rb") as file:
                os.kill(old, signal.SIGSEGV)
                fcntl.flock(file, fcntl.LOCK_EX)  # as the master does, which moves the file aside
                async with asyncio.timeout(PATIENCE_S):
                    event = await ended.next()
            assert (event.reason, event.restarts) == ("died: signal 11", number)
            await back(run_dir, "timesync", old)
        assert (await service(module, "timesync")).restarts == 2


async def test_guard_that_hangs_is_replaced_by_monitor(tmp_path: Path) -> None:
    run_dir = tmp_path / "uav1/run"
    services = {"health": {"hung_s": 1.6}, "guard": {}, "timesync": {}}
    async with guarded(tmp_path, **services) as config, Module("probe", config_dir=config) as module:
        state = module.reader("health/state", HealthState)
        async with asyncio.timeout(PATIENCE_S):
            while state.value is None or state.value.guard != "alive":
                await state.changed()
        before = pids(run_dir)
        os.kill(before["guard"], signal.SIGSTOP)
        await back(run_dir, "guard", before["guard"])
        assert pids(run_dir)["timesync"] == before["timesync"]


async def test_requested_restart_is_new_process_or_named_error(tmp_path: Path) -> None:
    run_dir = tmp_path / "uav1/run"
    async with (
        guarded(tmp_path, guard={}, timesync={}) as config,
        Module("probe", config_dir=config) as module,
    ):
        old = pids(run_dir)["timesync"]
        await asked(module, "sys/guard/restart", RestartOrder("timesync"), GuardStatus)
        await back(run_dir, "timesync", old)
        with pytest.raises(NotFound, match="nosuch"):
            await module.request(
                "sys/guard/restart", RestartOrder("nosuch"), GuardStatus, timeout_s=PATIENCE_S
            )


async def test_second_guard_refuses_to_run_beside_first(tmp_path: Path) -> None:
    async with guarded(tmp_path, guard={}, timesync={}) as config:
        before = pids(tmp_path / "uav1/run")
        with pytest.raises(SwarmError, match="one writer only"):
            async with spawn(config, "guard"):
                pass
        assert pids(tmp_path / "uav1/run") == before


async def test_guard_in_one_process_lets_runner_restart(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"timesync": {}, "guard": {}, "health": {}})
    with no_leaks(tmp_path / "uav1/run", tmp_path / "uav1/shm"):
        async with spawn(config), Module("probe", config_dir=config) as module:
            status = await asked(module, "sys/guard/status", Empty(), GuardStatus)
            assert status.supervisor == "runner"
            before = pids(tmp_path / "uav1/run")["timesync"]
            await asked(module, "sys/guard/restart", RestartOrder("timesync"), GuardStatus)
            async with asyncio.timeout(PATIENCE_S):
                restarted = module.reader("guard/status", GuardStatus)
                while restarted.value is None or restarted.value.restarts == 0:
                    await restarted.changed()
            assert pids(tmp_path / "uav1/run")["timesync"] == before
