"""The owner of a ring: one process of one boot, distinguished from a later process with the same pid."""

import functools
import os
from pathlib import Path

import msgspec

from swarmware.runtime.pidfd import lives, start_ticks


@functools.cache
def boot_id() -> int:
    """Random 128-bit number of this boot of the machine."""
    return int(
        Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip().replace("-", ""), 16
    )


class Owner(msgspec.Struct, frozen=True):
    """The process that writes a ring."""

    pid: int
    """pid of the owner, or 0 without an owner."""
    start_ticks: int
    boot_id: int

    @classmethod
    def current(cls) -> "Owner":
        """Owner that stands for this process."""
        pid = os.getpid()
        return cls(pid, start_ticks(pid), boot_id())

    def alive(self) -> bool:
        """Whether exactly this process still runs, as far as this PID namespace can see."""
        return self.pid != 0 and self.boot_id == boot_id() and lives(self.pid, self.start_ticks)
