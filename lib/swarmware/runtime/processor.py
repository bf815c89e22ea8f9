"""Use of the processors of the whole computer, as the kernel counts it."""

from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
_IDLE: Final = slice(3, 5)
"""Columns idle and iowait of the first line of /proc/stat. Source: proc_stat(5)."""
_COUNTED: Final = 8
"""Columns user to steal; the time of guests behind them is part of user and nice already."""


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
