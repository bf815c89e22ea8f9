"""Pace of a recording: when each of its entries is due, and the stamp that it gets."""

from typing import Final

_CATCH_UP_NS: Final = 1_000_000_000
"""Longest stall that is caught up; after a longer one the recording continues where it was."""


class Playback:
    """Instants of a recording in the clock of this computer.

    `speed`: seconds of the recording in one second. An instant of the recording is in its own clock.
    """

    def __init__(self, first_ns: int, start_ns: int, speed: float) -> None:
        self._first_ns = first_ns
        self._start_ns = start_ns
        self._speed = speed
        self.stalled_ns = 0
        """Sum of the stalls that were not caught up."""

    def local_ns(self, recorded_ns: int) -> int:
        """The instant in the clock of this computer."""
        return self._start_ns + round((recorded_ns - self._first_ns) / self._speed)

    def is_due(self, recorded_ns: int, now_ns: int) -> bool:
        """Whether an entry is to be published now."""
        late_ns = now_ns - self.local_ns(recorded_ns)
        if late_ns > _CATCH_UP_NS:
            self._start_ns += late_ns
            self.stalled_ns += late_ns
        return late_ns >= 0
