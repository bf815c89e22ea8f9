"""How much a check may use: a mission comes from outside and must not take the node's memory or time."""

from typing import Final

FULL_BYTES: Final = 64 << 20
"""For a check in a process of its own: some 80 000 states of a common mission, about one second."""
QUICK_BYTES: Final = 1 << 20
"""For a check inside an event loop: some 1 500 states, 5 to 30 ms (shipped missions have less than 50)."""


class Budget:
    """Memory that a check may use, in bytes; as each state and step costs some, time is bounded with it."""

    def __init__(self, size: int = FULL_BYTES) -> None:
        self._left = size

    @property
    def spent(self) -> bool:
        """Nothing is left: the check must give up."""
        return self._left <= 0

    def pay(self, size: int) -> None:
        """Something that takes so many bytes is kept."""
        self._left -= size
