"""Measurement of the load of the services' processes, and setting of their priorities and cores."""

import logging
import os
import resource
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final

from swarmd.guard.core.priorities import (
    DEMOTED,
    PROMOTED,
    PriorityCore,
    ProcessPriority,
    ServiceLoad,
    SetPriority,
)
from swarmware.runtime.processor import ProcessorUse
from swarmware.types.system import AppStatus

PERIOD_NS: Final = 900_000_000
"""Minimum time between two samples, a little less than the 1 s between heartbeats."""
_CAP_SYS_NICE: Final = 1 << 23

log = logging.getLogger("swarm.guard")


class ProcessPriorities:
    """Sets niceness and cores of processes; only cores if a niceness would be irreversible."""

    def __init__(self) -> None:
        self._cores = tuple(sorted(os.sched_getaffinity(0)))
        lowest = lowest_nice()
        self._core = PriorityCore(self._cores, lowest)
        self._use = ProcessorUse()
        self._sampled_ns = 0
        if lowest > 0:
            what = "only cores" if len(self._cores) > 1 else "nothing"
            log.info("priorities: a niceness could not be taken back (LimitNICE=); %s is set by load", what)

    def of(self, name: str) -> ProcessPriority:
        """The priority of a service."""
        return self._core.of(name)

    def sample(self, statuses: Iterable[tuple[str, AppStatus]], now_ns: int) -> None:
        """Takes the status boards of the services, at most once a second."""
        if now_ns - self._sampled_ns < PERIOD_NS:
            return
        busy_ratio, first = self._use.percent() / 100, self._sampled_ns == 0
        self._sampled_ns = now_ns
        loads = [
            ServiceLoad(name, status.pid, status.cpu_percent, status.loop_lag_ms) for name, status in statuses
        ]
        if first:
            # the first measurement of the processor's use covers no time, and decides nothing
            self._find(loads)
            return
        was_pressed = self._core.pressed
        for action in self._core.on_loads(busy_ratio, loads, now_ns):
            self._set(action)
        if self._core.pressed != was_pressed:
            log.info("priorities: the processor is %s", "short" if self._core.pressed else "relaxed")

    def _find(self, loads: Iterable[ServiceLoad]) -> None:
        """Takes over the priorities that the previous, killed guard has set."""
        for load in loads:
            with suppress(ProcessLookupError):
                nice = os.getpriority(os.PRIO_PROCESS, load.pid)
                cores = tuple(sorted(os.sched_getaffinity(load.pid)))
                if nice in (DEMOTED, PROMOTED) or cores == self._cores[1:]:
                    found = ProcessPriority(nice, () if cores == self._cores else cores)
                    self._core.on_found(load.name, load.pid, found)

    def _set(self, action: SetPriority) -> None:
        """Sets the main thread of a process, which runs the event loop; other threads keep their
        priorities."""
        wanted = action.priority
        try:
            if os.getpriority(os.PRIO_PROCESS, action.pid) != wanted.nice:
                os.setpriority(os.PRIO_PROCESS, action.pid, wanted.nice)
            os.sched_setaffinity(action.pid, wanted.cores or self._cores)
        except ProcessLookupError:
            return  # the process has ended, and the next one starts with the default
        except OSError as error:
            self._core.on_refused(action.name)
            log.warning("%s: priority %d: %s; it is not set again", action.name, wanted.nice, error)
            return
        cores = ",".join(map(str, wanted.cores)) or "all"
        log.info("%s: niceness %d, cores %s", action.name, wanted.nice, cores)


def lowest_nice() -> int:
    """Lowest niceness that this process may set, by RLIMIT_NICE or the capability CAP_SYS_NICE."""
    for line in Path("/proc/self/status").read_text("ascii").splitlines():
        name, _, value = line.partition(":")
        if name == "CapEff" and int(value, 16) & _CAP_SYS_NICE:
            return -20
    # the limit counts from 1 for niceness 19 to 40 for -20 (getrlimit(2))
    return 20 - resource.getrlimit(resource.RLIMIT_NICE)[0]
