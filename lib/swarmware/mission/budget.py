"""Budget of a check: a mission from outside must not exhaust the memory or time of the node."""

from typing import Final

FULL_BYTES: Final = 64 << 20
"""Budget of a command and of a separate process: some 50 000 states of a common mission, about one second."""
QUICK_BYTES: Final = 2 << 20
"""Budget in an event loop: some 2 000 states, at most 25 ms. The shipped formation takes 1.6 MB and 19 ms; a
mission beyond this budget is checked in a process of its own, which a computer that flies has to start."""


class Budget:
    """Budget of a check, in bytes: states pay for their memory, and all steps for their time.

    No clock has an effect: the same mission has the same verdict on every computer.
    """

    def __init__(self, size: int = FULL_BYTES) -> None:
        self._left = size

    @property
    def spent(self) -> bool:
        """Whether the budget is exceeded: the check must be abandoned."""
        return self._left <= 0

    def pay(self, size: int) -> None:
        """Add bytes to the used memory."""
        self._left -= size
