"""Real-time scheduling of the processes of declared services (S2.56)."""

from __future__ import annotations

import logging
import os
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swarmware.model.config import RealtimeConfig

POLICIES: Final = {"fifo": os.SCHED_FIFO, "rr": os.SCHED_RR}

log = logging.getLogger("swarm.host")


def give_realtime(config: RealtimeConfig, names: Sequence[str]) -> str:
    """Gives this process the scheduling that is declared for its services; threads begin with the same.

    Returns why a declared one is not given; empty: it is, or none is declared.
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
    return ""
