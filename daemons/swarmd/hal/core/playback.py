"""Pace of a recording, which gives each entry a due instant and a stamp."""

from typing import Final

_CATCH_UP_NS: Final = 1_000_000_000
"""Maximum stall that is caught up; after a longer stall the recording continues where it was."""


class Playback:
    """Converts instants of a recording to the clock of this computer.

    `speed`: seconds of the recording that are played in one second. The recording has its own clock.
    """

    def __init__(self, first_ns: int, start_ns: int, speed: float) -> None:
        self._first_ns = first_ns
        self._start_ns = start_ns
        self._speed = speed
        self.stalled_ns = 0
        """Sum of the stalls that were not caught up."""

    def local_ns(self, recorded_ns: int) -> int:
        """Converts an instant of the recording to the clock of this computer."""
        return self._start_ns + round((recorded_ns - self._first_ns) / self._speed)

    def is_due(self, recorded_ns: int, now_ns: int) -> bool:
        """True if an entry is to be published now; a long stall shifts all later entries."""
        late_ns = now_ns - self.local_ns(recorded_ns)
        if late_ns > _CATCH_UP_NS:
            self._start_ns += late_ns
            self.stalled_ns += late_ns
        return late_ns >= 0
