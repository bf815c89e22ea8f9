"""Processor time and memory of the nodes' processes."""

import time

import msgspec
import psutil

from swarmctl.session import processes
from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK


class Usage(msgspec.Struct, frozen=True):
    """Resource use of one node at one instant."""

    mono_s: float
    cpu_s: float
    """Processor time of all its processes so far."""
    rss_mb: float
    """Resident memory of all its processes (RSS): pages that are shared count in each; 1 MB is 10⁶ bytes."""
    pss_mb: float = 0.0
    """The same with shared pages divided among those who share them (PSS)."""


def usage(lab: LabState) -> dict[str, Usage]:
    """Present processor time and memory of every node."""
    running = processes.by_mark(NODE_MARK)
    found = {}
    for node in lab.nodes:
        cpu_s = rss = pss = 0.0
        for who in running.get(node.folder, ()):
            try:
                process = psutil.Process(who.pid)
                with process.oneshot():
                    times, memory = process.cpu_times(), process.memory_full_info()
            except psutil.Error:
                continue  # it has just ended
            cpu_s += times.user + times.system
            rss += memory.rss
            pss += memory.pss
        found[node.platform] = Usage(time.monotonic(), cpu_s, rss / 1e6, pss / 1e6)
    return found


def percent(before: Usage, after: Usage) -> float:
    """Processor time between two instants, in percent of one core."""
    elapsed_s = after.mono_s - before.mono_s
    return max(0.0, after.cpu_s - before.cpu_s) / elapsed_s * 100 if elapsed_s > 0 else 0.0
