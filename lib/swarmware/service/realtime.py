"""Real-time scheduling of the processes of declared services, with their memory locked (S2.56)."""

from __future__ import annotations

import ctypes
import errno
import logging
import os
import resource
from collections.abc import Sequence
from typing import Final

from swarmware.model.config import RealtimeConfig

POLICIES: Final = {"fifo": os.SCHED_FIFO, "rr": os.SCHED_RR}

_LOCK_ALL: Final = 1 | 2 | 4
"""MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT: a page stays once it was used; rings are not loaded at once.

Source: Linux, include/uapi/asm-generic/mman.h."""

log = logging.getLogger("swarm.host")


def give_realtime(config: RealtimeConfig, names: Sequence[str]) -> str:
    """Gives this process the scheduling that is declared for its services; threads begin with the same.

    Returns the reason if declared scheduling is not in force, or "".
    """
    declared = {name: config.services[name] for name in names if name in config.services}
    if not declared:
        return ""
    if others := [name for name in names if name not in declared]:
        return (
            f"{', '.join(declared)} shares its process with {', '.join(others)}; expected a process of its"
            ' own: processes = "per-daemon", or a unit of systemd for each'
        )
    priority = max(declared.values())
    try:
        os.sched_setscheduler(0, POLICIES[config.policy], os.sched_param(priority))
    except PermissionError:
        return (
            f"{config.policy} {priority} is not permitted; expected LimitRTPRIO={priority} (realtime.conf),"
            " or CAP_SYS_NICE"
        )
    except OSError as error:
        return f"{config.policy} {priority}: {error.strerror}; expected a kernel with real-time scheduling"
    log.info("%s: real-time scheduling, %s %d", ", ".join(declared), config.policy, priority)
    return lock_memory()


def lock_memory() -> str:
    """Keep the pages of this process in memory, so that no page is read from a disk while a vehicle flies.

    Returns the reason if memory is not locked, or "".
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    expected = "expected LimitMEMLOCK=infinity (realtime.conf), or CAP_IPC_LOCK"
    if limit != resource.RLIM_INFINITY and not _privileged():
        # below the limit it would succeed, and a later allocation fail
        return f"memory is not locked: at most {limit // 1024} KiB are permitted; {expected}"
    if ctypes.CDLL(None, use_errno=True).mlockall(_LOCK_ALL):
        return f"memory is not locked: {errno.errorcode[ctypes.get_errno()]}; {expected}"
    log.info("memory is locked")
    return ""


def _privileged() -> bool:
    """Whether this process has CAP_IPC_LOCK."""
    with open("/proc/self/status", encoding="ascii") as file:  # noqa: PTH123  # no pathlib at the start
        found = next(line for line in file if line.startswith("CapEff:"))
    return bool(int(found.split()[1], 16) >> 14 & 1)
