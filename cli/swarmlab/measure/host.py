"""The computer of a lab: its hardware, and the processor time of the lab and of other processes."""

import os
import platform
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec
import psutil

CPUINFO: Final = Path("/proc/cpuinfo")


class HostInfo(msgspec.Struct, frozen=True):
    """Properties and load of the computer during a run, to explain missed goals."""

    processor: str = ""
    """Model name; the architecture where the kernel gives none."""
    cores: int = 0
    kernel: str = ""
    load_before: float | None = None
    """Load average of the last minute before the first node was started."""
    nodes_percent: float | None = None
    """Processor time of all nodes from the command to the end, in percent of one core."""
    others_percent: float | None = None
    """Processor time of everything else meanwhile, in percent of one core."""

    def summary(self) -> str:
        """Short description for messages."""
        words = [f"{self.cores} cores ({self.processor})"]
        if self.load_before is not None:
            words.append(f"load {self.load_before:.1f} before the start")
        if self.nodes_percent is not None and self.others_percent is not None:
            words.append(f"nodes used {self.nodes_percent:.0f} % of a core")
            words.append(f"other processes {self.others_percent:.0f} %")
        return ", ".join(words)


class CpuTime(msgspec.Struct, frozen=True):
    """Processor time that the whole computer has spent."""

    mono_s: float
    cpu_s: float


def describe() -> HostInfo:
    """Describes this computer before a run."""
    return HostInfo(
        processor(), os.cpu_count() or 1, platform.release().partition("-")[0], os.getloadavg()[0]
    )


def busy() -> CpuTime:
    """Total processor time of all cores up to now."""
    times = psutil.cpu_times()
    # guest time is part of user time already; time stolen by other machines is busy for us
    spent = times.user + times.nice + times.system + times.irq + times.softirq + times.steal
    return CpuTime(time.monotonic(), spent)


def shares(
    host: HostInfo, before: CpuTime, after: CpuTime, nodes_percent: Iterable[float | None]
) -> HostInfo:
    """Adds the use of the nodes and of other processes between two instants, if it is known for all nodes."""
    elapsed_s = after.mono_s - before.mono_s
    known: list[float] = []
    for percent in nodes_percent:
        if percent is None:
            return host
        known.append(percent)
    if elapsed_s <= 0:
        return host
    nodes = sum(known)
    whole = (after.cpu_s - before.cpu_s) / elapsed_s * 100
    # the two counters are read at slightly different instants, so a small difference may be negative
    return msgspec.structs.replace(host, nodes_percent=nodes, others_percent=max(0.0, whole - nodes))


def processor(cpuinfo: Path = CPUINFO) -> str:
    """Model name of the first processor."""
    try:
        lines = cpuinfo.read_text("utf-8", "replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name" and value.strip():
            return value.strip()
    return platform.machine()
