"""A process that takes a whole core while the processor is short yields: its niceness and cores change."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from tests.patience import PATIENCE_S

from swarmd.guard.core.priorities import DEMOTED
from swarmd.guard.priorities import ProcessPriorities, lowest_nice
from swarmware.types.system import AppState, AppStatus


@contextmanager
def burning(count: int) -> Iterator[list[int]]:
    """Processes that use a core each."""
    started = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
            process.wait()


def test_heavy_process_yields_cores_and_next_guard_knows() -> None:
    if lowest_nice() > 0 and len(os.sched_getaffinity(0)) == 1:
        pytest.skip("without rights and with one core nothing can be set")
    everything = os.sched_getaffinity(0)
    with burning(len(everything) + 1) as pids:
        priorities = ProcessPriorities()
        heavy = AppStatus(pids[0], AppState.RUNNING, 1, cpu_percent=70.0, loop_lag_ms=1.0)
        calm = AppStatus(pids[1], AppState.RUNNING, 1, cpu_percent=2.0, loop_lag_ms=1.0)
        end_s = time.monotonic() + PATIENCE_S
        while not any(priorities.of("logger")):
            assert time.monotonic() < end_s, "the load was not seen"
            time.sleep(1.0)  # a heartbeat comes once a second
            priorities.sample([("logger", heavy), ("mission", calm)], time.monotonic_ns())
        if lowest_nice() <= 0:
            assert os.getpriority(os.PRIO_PROCESS, pids[0]) == DEMOTED
        if len(everything) > 1:
            assert os.sched_getaffinity(pids[0]) == everything - {min(everything)}
        assert os.getpriority(os.PRIO_PROCESS, pids[1]) == 0
        assert os.sched_getaffinity(pids[1]) == everything

        # a guard that is started after this one was killed takes over what it has set
        again = ProcessPriorities()
        again.sample([("logger", heavy), ("mission", calm)], time.monotonic_ns())
        assert again.of("logger") == priorities.of("logger")
        assert not any(again.of("mission"))
