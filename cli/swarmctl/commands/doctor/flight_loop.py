"""The check of the flight loop: whether other work on this computer can delay it."""

import os
from typing import Final, Literal, NamedTuple

from swarmware.model.config import NodeConfig
from swarmware.transport.appfile.table import AppTable

SERVICE: Final = "hal"
POLICIES: Final = {os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
_RESET_ON_FORK: Final = 0x40000000
"""Flag that sched_getscheduler adds (SCHED_RESET_ON_FORK). Source: Linux, include/uapi/linux/sched.h."""


class LoopFinding(NamedTuple):
    """Result of the check."""

    verdict: Literal["ok", "warning"]
    text: str
    advice: str = ""


def check_flight_loop(node: NodeConfig, table: AppTable) -> LoopFinding | None:
    """How the process of the flight controller is scheduled, or None if no flight controller runs here."""
    pids = [entry.pid for entry in table if entry.name == SERVICE]
    # without an airframe there is no flight loop to delay
    if not node.airframe or not pids:
        return None
    try:
        policy = os.sched_getscheduler(pids[0]) & ~_RESET_ON_FORK
    except OSError:
        return None  # it has ended since the table was read
    if policy in POLICIES:
        priority = os.sched_getparam(pids[0]).sched_priority
        return LoopFinding("ok", f"{SERVICE}: {POLICIES[policy]} {priority}")
    if SERVICE in node.realtime.services:
        return LoopFinding(
            "warning",
            f"{SERVICE} runs without the real-time scheduling that node.toml declares",
            f"see the fault {SERVICE}/realtime: swarmctl health faults",
        )
    return LoopFinding(
        "warning",
        f"{SERVICE} has no real-time scheduling: other work delays the flight loop",
        f"[realtime] services = {{ {SERVICE} = 50 }} in node.toml, with realtime.conf; simulations need none",
    )
