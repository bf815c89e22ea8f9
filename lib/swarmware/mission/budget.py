"""Budget of a check: a mission from outside must not exhaust the memory or time of the node."""

from typing import Final

FULL_BYTES: Final = 64 << 20
"""Budget in a separate process: some 80 000 states of a common mission, about one second."""
QUICK_BYTES: Final = 1 << 20
"""Budget in an event loop: some 1 500 states, 5 to 30 ms (shipped missions have less than 50)."""


class Budget:
    """Memory that a check may use, in bytes; each state and step uses some, so the time is bounded as
    well."""

    def __init__(self, size: int = FULL_BYTES) -> None:
        self._left = size

    @property
    def spent(self) -> bool:
        """Whether the budget is exceeded: the check must be abandoned."""
        return self._left <= 0

    def pay(self, size: int) -> None:
        """Add bytes to the used memory."""
        self._left -= size
