"""Readings of the computer from the kernel's files: use of the processors, memory, disk, temperature.

psutil reads the same files, and costs each node a megabyte of resident memory.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
SYS: Final = Path("/sys")
_IDLE: Final = slice(3, 5)
"""Columns idle and iowait of the first line of /proc/stat. Source: proc_stat(5)."""
_COUNTED: Final = 8
"""Columns user to steal; the time of guests behind them is part of user and nice already."""
_HARDWARE: Final = ("class/hwmon/hwmon*/temp*_input", "class/hwmon/hwmon*/device/temp*_input")
"""Sensors of the computer, in thousandths of a degree Celsius. Source: Linux, hwmon/sysfs-interface."""
_ZONES: Final = "class/thermal/thermal_zone*/temp"
"""Where there is no such sensor. Source: Linux, thermal/sysfs-api."""


class ProcessorUse:
    """Use of all processors between two looks."""

    def __init__(self, proc: Path = PROC) -> None:
        self._stat = proc / "stat"
        self._busy, self._total = self._ticks()

    def percent(self) -> float:
        """Use since the last look, 0 to 100; 0 within the same clock tick."""
        busy, total = self._ticks()
        used, passed = busy - self._busy, total - self._total
        self._busy, self._total = busy, total
        # iowait may go backwards, proc_stat(5)
        return round(min(max(100 * used / passed, 0.0), 100.0), 1) if passed > 0 else 0.0

    def _ticks(self) -> tuple[int, int]:
        with self._stat.open("rb") as file:
            counted = [int(field) for field in file.readline().split()[1 : _COUNTED + 1]]
        total = sum(counted)
        return total - sum(counted[_IDLE]), total


def memory_used_ratio(proc: Path = PROC) -> float:
    """Memory that a new process could not have without swapping, 0 to 1.

    Source: proc_meminfo(5), MemAvailable.
    """
    kib: dict[str, int] = {}
    for line in (proc / "meminfo").read_text("ascii").splitlines():
        name, _, value = line.partition(":")
        if name in {"MemTotal", "MemAvailable"}:
            kib[name] = int(value.split()[0])
    return 1 - min(kib["MemAvailable"] / kib["MemTotal"], 1.0)


def disk_free_bytes(path: str) -> int:
    """Space that a process without privileges may use."""
    disk = os.statvfs(path)
    return disk.f_bavail * disk.f_frsize


def temperature_degc(sys: Path = SYS) -> float | None:
    """Temperature of the hottest sensor; None without sensors."""
    hardware = [value for pattern in _HARDWARE for value in _degrees(sys, pattern)]
    found = hardware or list(_degrees(sys, _ZONES))
    return round(max(found), 1) if found else None


def _degrees(sys: Path, pattern: str) -> Iterator[float]:
    for path in sys.glob(pattern):
        try:
            yield int(path.read_text("ascii")) / 1000
        except (OSError, ValueError):  # a sensor that is switched off, or goes away
            continue
