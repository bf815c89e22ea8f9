"""What the broker writes to the journal about refused input: two lines a minute, however much is refused."""

from typing import Final, NamedTuple

import msgspec

from swarmware.types.net import CERTAINLY_HOSTILE, HOSTILE, Refused

LOG_NS: Final = 60_000_000_000
"""Minimum period between two lines of one level."""


class RefusalLine(NamedTuple):
    """A line for the journal."""

    is_warning: bool
    """An operator should act: it has input that no valid member sends."""
    text: str


class RefusalLog:
    """Compares the counters of refused input with those of the last line."""

    def __init__(self) -> None:
        self._logged = dict.fromkeys(HOSTILE, 0)
        self._logged_ns = {True: -LOG_NS, False: -LOG_NS}
        """Instant of the last warning, and of the last other line."""

    def on_counters(self, refused: Refused, now_ns: int) -> RefusalLine | None:
        """The line that is due now; None: nothing was refused since the last one, or that was recent."""
        counts = msgspec.structs.asdict(refused)
        risen = {name: counts[name] - self._logged[name] for name in HOSTILE}
        is_warning = any(risen[name] > 0 for name in CERTAINLY_HOSTILE)
        found = ", ".join(f"{count} {name}" for name, count in risen.items() if count > 0)
        if not found or now_ns - self._logged_ns[is_warning] < LOG_NS:
            return None
        self._logged = {name: counts[name] for name in HOSTILE}
        self._logged_ns[is_warning] = now_ns
        return RefusalLine(is_warning, f"refused input: {found}")
