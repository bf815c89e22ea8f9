"""The owner of a ring: one process of one boot, told apart from a later process with the same number."""

import functools
import os
from pathlib import Path

import msgspec

_STATE, _START = 0, 19
"""Positions of state (field 3) and starttime (field 22) behind the command name. Source: proc_pid_stat(5)."""

_DEAD_STATES = frozenset("ZXx")
"""A zombie runs no code any more; it only waits for its parent to ask for the exit status."""


@functools.cache
def boot_id() -> int:
    """Random 128-bit number of this boot of the machine."""
    return int(
        Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip().replace("-", ""), 16
    )


def start_ticks(pid: int) -> int:
    """When the process started, in clock ticks since boot; 0 when it does not run.

    The command name may hold blanks and parentheses: fields count from the last ')'.
    Source: proc_pid_stat(5).
    """
    if not 0 < pid <= 0x7FFF_FFFF:
        return 0
    try:
        with Path(f"/proc/{pid}/stat").open("rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    if len(fields) <= _START or fields[_STATE].decode("ascii", "replace") in _DEAD_STATES:
        return 0
    return int(fields[_START])


class Owner(msgspec.Struct, frozen=True):
    """Who writes a ring."""

    pid: int
    """0: nobody."""
    start_ticks: int
    boot_id: int

    @classmethod
    def current(cls) -> "Owner":
        """This process."""
        pid = os.getpid()
        return cls(pid, start_ticks(pid), boot_id())

    def alive(self) -> bool:
        """Whether exactly this process still runs, as far as this PID namespace can see."""
        return self.pid != 0 and self.boot_id == boot_id() and start_ticks(self.pid) == self.start_ticks != 0
