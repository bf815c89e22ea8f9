"""Reports removed and damaged files of a process as a fault of the platform."""

from typing import Final

from swarmware.health.held_condition import HeldCondition
from swarmware.health.monitor import HealthMonitor
from swarmware.node.run_files import Damage

NAMED: Final = 3
"""Paths that a fault names; the log has all."""


class DamageReport:
    """The condition `files` of one service, which reports for its process."""

    def __init__(self, monitor: HealthMonitor) -> None:
        self._condition = HeldCondition(
            monitor, "files", "Files of this process in the run directory and in shared memory are its own"
        )

    def on_damage(self, damage: Damage) -> None:
        """Report what was found; files that were made again are a warning for a while."""
        if damage.errors:
            self._condition.raise_fault("lost", "error", _shown(damage.errors))
            return
        if damage.repaired:
            text = f"removed while the node ran, and made again: {_shown(damage.repaired)}"
            self._condition.raise_fault("restored", "warn", text)
        self._condition.clear()

    def close(self) -> None:
        """End the report with its service."""
        self._condition.close()


def _shown(lines: tuple[str, ...]) -> str:
    more = len(lines) - NAMED
    return "; ".join(lines[:NAMED]) + (f" and {more} more" if more > 0 else "")
