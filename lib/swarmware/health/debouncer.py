"""Debouncing: a state is confirmed by n of the last m samples, and none during the grace time."""

from collections import deque

from swarmware.errors import InvalidInput
from swarmware.types.health import OK_STATE


class Debouncer:
    """Derives the confirmed state of one check from its samples."""

    def __init__(self, *, confirm_n: int = 1, confirm_m: int = 1, grace_until_ns: int | None = None) -> None:
        """Raises: InvalidInput unless 1 ≤ n ≤ m."""
        if not 1 <= confirm_n <= confirm_m:
            raise InvalidInput(f"confirm {confirm_n} of {confirm_m}: expected 1 ≤ n ≤ m")
        self._n = confirm_n
        self._samples: deque[str] = deque(maxlen=confirm_m)
        self._grace_until_ns = grace_until_ns
        self.confirmed = OK_STATE
        """The confirmed state."""
        self.raw = OK_STATE
        """State of the last sample."""

    def on_sample(self, state: str, now_ns: int) -> bool:
        """Add a sample; True if another state is confirmed."""
        if self._grace_until_ns is not None:
            # samples of the start do not count later either
            if now_ns < self._grace_until_ns:
                return False
            self._grace_until_ns = None
        self.raw = state
        self._samples.append(state)
        # n of the last m, not n in a row: a single good sample must not hide a fault
        if state == self.confirmed or self._samples.count(state) < self._n:
            return False
        self.confirmed = state
        return True
