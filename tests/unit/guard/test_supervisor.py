"""The supervisor signals the process that a record names, never a later one with the same pid."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmd.guard.process_supervisor import ProcessSupervisor
from swarmware.runtime.pidfd import start_ticks
from swarmware.service.exit_status import ExitStatus
from swarmware.service.starting import write_start_record


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    """A process that the guard has not started."""
    process = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(60)"])
    yield process
    process.kill()
    process.wait()


def supervisor(run_dir: Path) -> ProcessSupervisor:
    def on_exit(name: str, pid: int, how: ExitStatus) -> None:
        raise AssertionError(f"{name} {pid} {how}")

    return ProcessSupervisor(run_dir, run_dir, on_exit)


async def test_foreign_process_is_watched_by_its_start(
    tmp_path: Path, child: subprocess.Popen[bytes]
) -> None:
    guard = supervisor(tmp_path)
    assert guard.watch("hal", child.pid, start_ticks(child.pid))
    guard.close()
    assert not guard.watch("hal", child.pid, start_ticks(child.pid) - 1), "it has the pid of an ended one"
    assert not guard.watch("hal", child.pid, 0), "no record names it"
    write_start_record("hal", child.pid, tmp_path)
    assert guard.watch("hal", child.pid, 0)
    guard.close()


async def test_process_with_reused_pid_is_not_killed(tmp_path: Path, child: subprocess.Popen[bytes]) -> None:
    guard = supervisor(tmp_path)
    guard.watch("hal", child.pid, start_ticks(child.pid) - 1)
    guard.kill("hal", child.pid)
    guard.terminate("hal", child.pid)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(0.2)
    guard.close()
