"""The arming gate: arming waits shortly for `health/ready`, and is refused if the vehicle is not ready."""

from contextlib import suppress
from typing import Final

from swarmware.errors import NoAnswer
from swarmware.module.module import Module
from swarmware.types.health import Readiness

WAIT_S: Final = 3.0
"""Maximum wait for readiness, whose first values take a second or two after the start of a node."""
FRESH_S: Final = 3.0
"""Age above which `health/ready`, published once a second, counts as unknown."""
MONITOR: Final = "health"
"""Service that publishes `health/ready`; a node without this service has no arming gate."""


class ArmingGate:
    """Reads `health/ready` of this node when the motors are to be armed."""

    def __init__(self, module: Module) -> None:
        self._module = module
        self._required = MONITOR in module.node.config.services
        self._board = module.reader("health/ready", Readiness)

    async def refusal(self) -> str:
        """Reason for which the vehicle may not be armed, after a wait of at most WAIT_S, or "" if it may."""
        end_ns = self._module.now_ns() + round(WAIT_S * 1e9)
        while reasons := self.reasons():
            remaining_ns = end_ns - self._module.now_ns()
            if remaining_ns <= 0:
                return f"not ready: {reasons}"
            # a time-out ends in the check above, which names the reasons
            with suppress(NoAnswer):
                await self._board.changed(remaining_ns / 1e9)
        return ""

    def reasons(self) -> str:
        """Reasons for which the vehicle is not ready now, in one line, or "" if it is ready."""
        # a node without the monitor would never become ready
        if not self._required:
            return ""
        found, age_s = self._board.value, self._board.age_s
        if found is None or age_s is None or not self._board.alive:
            return f"health: no health/ready; expected it of the service {MONITOR}"
        if age_s > FRESH_S:
            return f"health: no health/ready for {age_s:.0f} s; expected it of the service {MONITOR}"
        return found.reasons
