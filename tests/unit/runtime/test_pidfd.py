"""A handle of one process: its end can be polled, a signal goes to it and to no later process."""

import select
import signal
import subprocess
import sys
from contextlib import closing

import pytest

from swarmware.runtime.pidfd import ProcessHandle, start_ticks


def test_process_end_is_readable_and_signal_lost() -> None:
    child = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(60)"])
    with closing(ProcessHandle(child.pid)) as handle:
        assert handle.pid == child.pid
        assert not select.select([handle], [], [], 0)[0]
        handle.signal(signal.SIGKILL)
        assert select.select([handle], [], [], 20)[0] == [handle]
        assert child.wait() == -signal.SIGKILL
        handle.signal(signal.SIGTERM)
    assert handle.fileno() == -1
    handle.signal(signal.SIGTERM)
    handle.close()


def test_process_that_does_not_run_has_no_handle() -> None:
    child = subprocess.Popen([sys.executable, "-S", "-c", ""])
    child.wait()
    with pytest.raises(ProcessLookupError):
        ProcessHandle(child.pid)


def test_later_process_with_same_pid_has_no_handle() -> None:
    child = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(60)"])
    try:
        started = start_ticks(child.pid)
        ProcessHandle(child.pid, started).close()
        with pytest.raises(ProcessLookupError, match=f"process {child.pid}: it has ended, a later one"):
            ProcessHandle(child.pid, started - 1)
    finally:
        child.kill()
        child.wait()
