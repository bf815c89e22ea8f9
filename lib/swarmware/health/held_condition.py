"""A condition whose cause may pass within a second: it stays reported for a while after that."""

import asyncio
from typing import Final

from swarmware.health.monitor import HealthMonitor
from swarmware.types.health import OK_STATE, Level

HOLD_S: Final = 60.0
"""Time for which the condition stays after its cause has gone: an operator sees it in `health faults`."""


class HeldCondition:
    """Reports one condition of a module; that it is over is reported later."""

    def __init__(self, monitor: HealthMonitor, name: str, description: str) -> None:
        self._monitor = monitor
        self._name = name
        self._description = description
        self._clearing: asyncio.TimerHandle | None = None

    def raise_fault(self, state: str, level: Level, detail: str) -> None:
        """Report a state, which stays until `clear`."""
        self.close()
        self._report(state, level, detail)

    def clear(self) -> None:
        """Report after `HOLD_S` that the condition is over, unless it occurs again."""
        self.close()
        self._clearing = asyncio.get_running_loop().call_later(HOLD_S, self._report, OK_STATE, "ok", "")

    def _report(self, state: str, level: Level, detail: str) -> None:
        self._monitor.report(self._name, state, level=level, detail=detail, description=self._description)

    def close(self) -> None:
        """Cancel a report that `clear` has planned."""
        if self._clearing is not None:
            self._clearing.cancel()
            self._clearing = None
