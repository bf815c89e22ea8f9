"""Under systemd the guard calls `systemctl`, here a stand-in that records its arguments."""

import asyncio
from pathlib import Path

from tests.patience import PATIENCE_S

from swarmd.guard.process_supervisor import SystemdSupervisor
from swarmware.service.exit_status import ExitStatus
from swarmware.service.starting import spawn, starting_pid
from swarmware.service.supervised_process import SupervisedProcess
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import make_node


def written(log: Path) -> str:
    return log.read_text()


async def said(log: Path) -> str:
    """Recorded arguments of systemctl, once it has ended."""
    async with asyncio.timeout(PATIENCE_S):
        await asyncio.gather(*(task for task in asyncio.all_tasks() if "systemctl" in task.get_name()))
    return written(log)


def systemctl(folder: Path) -> tuple[str, Path]:
    log = folder / "asked"
    script = folder / "systemctl"
    script.write_text(f'#!/bin/sh\necho "$@" > {log}\n')
    script.chmod(0o700)
    return str(script), log


async def test_restart_is_requested_from_systemd_without_password(tmp_path: Path) -> None:
    command, log = systemctl(tmp_path)
    supervisor = SystemdSupervisor(tmp_path, tmp_path, lambda *_: None, command)
    supervisor.terminate("broker", 0)
    assert await said(log) == "--no-block --no-ask-password restart swarmd@broker.service\n"
    supervisor.close()


async def test_service_without_process_is_restarted_not_started(tmp_path: Path) -> None:
    command, log = systemctl(tmp_path)
    supervisor = SystemdSupervisor(tmp_path, tmp_path, lambda *_: None, command)
    assert supervisor.spawn("tree") == 0
    assert not supervisor.stops_services
    supervisor.kill("tree", 0)
    assert (await said(log)).endswith("restart swarmd@tree.service\n")
    supervisor.close()


async def test_child_is_found_by_note_until_joined(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={})
    run_dir = tmp_path / "uav1/run"
    run_dir.mkdir()
    with no_leaks():
        started = spawn("nosuch", config, run_dir)
        assert starting_pid("nosuch", run_dir) == started.pid
        ended: asyncio.Future[ExitStatus] = asyncio.get_running_loop().create_future()
        child = SupervisedProcess(started, ended.set_result)
        assert await asyncio.wait_for(ended, PATIENCE_S) == ExitStatus(code=6)
        child.close()
        assert starting_pid("nosuch", run_dir) == 0
