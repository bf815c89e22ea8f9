"""The compression `auto` of a resource: on while it saves enough for its processor time, else off."""

from enum import StrEnum
from typing import Final

from swarmware.model.compression import Compression, Method
from swarmware.runtime.backoff import pause_after

CODED: Final = Compression(Method.ZSTD, 1)
"""The least processor time for its reduction (`tests/bench/compression.py`)."""
PLAIN: Final = Compression()
REDUCTION_MIN: Final = 0.1
"""Share of the bytes that must be saved."""
CORE_MAX: Final = 0.25
"""Share of one core that it may take: what S3 reports for its point clouds."""
WINDOW_NS: Final = 2_000_000_000
"""Time over which both are measured."""
RUNS_MIN: Final = 3
"""Compressed runs after which a window may end: one slow value is none."""
RETRY_NS: Final = (30_000_000_000, 60_000_000_000, 120_000_000_000, 300_000_000_000)
"""Pauses before it is tried again, by the number of vain trials in a row."""


class AutoState(StrEnum):
    """Whether values are compressed."""

    TRIAL = "trial"
    ON = "on"
    OFF = "off"


class AutoEvent(StrEnum):
    """Results of a window, and the end of a pause."""

    PAYS = "pays"
    COSTS = "costs"
    PAUSE_OVER = "pause over"


TRANSITIONS: Final[dict[tuple[AutoState, AutoEvent], AutoState]] = {
    (AutoState.TRIAL, AutoEvent.PAYS): AutoState.ON,
    (AutoState.TRIAL, AutoEvent.COSTS): AutoState.OFF,
    (AutoState.ON, AutoEvent.COSTS): AutoState.OFF,
    (AutoState.OFF, AutoEvent.PAUSE_OVER): AutoState.TRIAL,
}
"""All transitions; any other event leaves the state unchanged."""


class AutoCompression:
    """Decides from measured sizes and processor times."""

    def __init__(self) -> None:
        self.state = AutoState.TRIAL
        self._retry_ns = 0
        self._vain = 0
        """Windows in a row that did not pay."""
        self._began_ns: int | None = None
        self._runs = self._plain_bytes = self._coded_bytes = self._spent_ns = 0

    def compression(self, now_ns: int) -> Compression:
        """What to do with the next values."""
        if self.state is AutoState.OFF and now_ns >= self._retry_ns:
            self._on(AutoEvent.PAUSE_OVER)
        if self.state is AutoState.OFF:
            return PLAIN
        if self._began_ns is None:
            self._began_ns = now_ns
        return CODED

    def on_coded(self, plain_bytes: int, coded_bytes: int, spent_ns: int, now_ns: int) -> None:
        """Values were compressed. `spent_ns`: processor time."""
        began_ns = now_ns if self._began_ns is None else self._began_ns
        self._runs += 1
        self._plain_bytes += plain_bytes
        self._coded_bytes += coded_bytes
        self._spent_ns += spent_ns
        elapsed_ns = now_ns - began_ns
        if elapsed_ns < WINDOW_NS or self._runs < RUNS_MIN:
            return
        saved = 1 - self._coded_bytes / self._plain_bytes if self._plain_bytes else 0.0
        pays = saved >= REDUCTION_MIN and self._spent_ns <= CORE_MAX * elapsed_ns
        if pays:
            self._vain = 0
        elif self.state is not AutoState.OFF:
            self._vain += 1
            self._retry_ns = now_ns + pause_after(self._vain, RETRY_NS)
        self._began_ns = None
        self._runs = self._plain_bytes = self._coded_bytes = self._spent_ns = 0
        self._on(AutoEvent.PAYS if pays else AutoEvent.COSTS)

    def _on(self, event: AutoEvent) -> None:
        """The only place that changes the state."""
        self.state = TRANSITIONS.get((self.state, event), self.state)
