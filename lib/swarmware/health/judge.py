"""When a state is believed: n of the last m results, and nothing during the start-up grace."""

from collections import deque

from swarmware.types.health import OK_STATE


class Judge:
    """Turns results into the believed state of one check."""

    def __init__(self, *, confirm_n: int = 1, confirm_m: int = 1, grace_until_ns: int | None = None) -> None:
        """Raises: ValueError unless 1 ≤ n ≤ m."""
        if not 1 <= confirm_n <= confirm_m:
            raise ValueError(f"confirm {confirm_n} of {confirm_m}: expected 1 ≤ n ≤ m")
        self._n = confirm_n
        self._results: deque[str] = deque(maxlen=confirm_m)
        self._grace_until_ns = grace_until_ns
        self.state = OK_STATE
        """Believed."""
        self.seen = OK_STATE
        """Of the last result."""

    def on_result(self, state: str, now_ns: int) -> bool:
        """One more result; True when another state is believed now."""
        if self._grace_until_ns is not None:
            if now_ns < self._grace_until_ns:
                return False
            self._grace_until_ns = None
        self.seen = state
        self._results.append(state)
        if state == self.state or self._results.count(state) < self._n:
            return False
        self.state = state
        return True
