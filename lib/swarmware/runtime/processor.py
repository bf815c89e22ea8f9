"""Processor time of the whole computer, as the kernel counts it."""

import os
from typing import Final

STAT: Final = "/proc/stat"
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


class ProcessorUse:
    """Use of all cores between two samples."""

    def __init__(self) -> None:
        self.cores = os.cpu_count() or 1
        self._before_s = busy_s()

    def take_s(self) -> float:
        """Processor time since the last call, of all cores."""
        now_s = busy_s()
        before_s, self._before_s = self._before_s, now_s
        return max(0.0, now_s - before_s)


def busy_s() -> float:
    """Processor time of this computer since its start, of all cores, without idle time."""
    with open(STAT, "rb") as file:  # noqa: PTH123  # read every second: no Path object
        user, nice, system, _, _, *rest = (int(word) for word in file.readline().split()[1:9])
    return (user + nice + system + sum(rest)) / _TICKS_PER_S
