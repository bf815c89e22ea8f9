"""Load of the computer from the kernel's files: processors, memory, disk and temperature.

psutil reads the same files, but would occupy a megabyte of memory in each node.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
SYS: Final = Path("/sys")
_HARDWARE: Final = ("class/hwmon/hwmon*/temp*_input", "class/hwmon/hwmon*/device/temp*_input")
"""Sensors of the computer, in thousandths of a degree Celsius. Source: Linux, hwmon/sysfs-interface."""
_ZONES: Final = "class/thermal/thermal_zone*/temp"
"""Thermal zones, for a computer without hwmon sensors. Source: Linux, thermal/sysfs-api."""


def memory_used_ratio(proc: Path = PROC) -> float:
    """Ratio of the memory that is not available to a new process without swapping, 0 to 1.

    Source: proc_meminfo(5), MemAvailable.
    """
    kib: dict[str, int] = {}
    for line in (proc / "meminfo").read_text("ascii").splitlines():
        name, _, value = line.partition(":")
        if name in {"MemTotal", "MemAvailable"}:
            kib[name] = int(value.split()[0])
    return 1 - min(kib["MemAvailable"] / kib["MemTotal"], 1.0)


def disk_free_bytes(path: str) -> int:
    """Disk space that an unprivileged process may use."""
    disk = os.statvfs(path)
    return disk.f_bavail * disk.f_frsize


def temperature_degc(sys: Path = SYS) -> float | None:
    """Temperature of the hottest sensor, or None without sensors."""
    # hwmon sensors are precise; boards without them have thermal zones only
    hardware = [value for pattern in _HARDWARE for value in _degrees(sys, pattern)]
    found = hardware or list(_degrees(sys, _ZONES))
    return round(max(found), 1) if found else None


def _degrees(sys: Path, pattern: str) -> Iterator[float]:
    for path in sys.glob(pattern):
        try:
            yield int(path.read_text("ascii")) / 1000
        except (OSError, ValueError):  # a sensor that is switched off or was removed
            continue
