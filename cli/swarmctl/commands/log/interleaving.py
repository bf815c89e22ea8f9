"""Merges the entries of several loggers into the order in which they were recorded."""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.recorder.entry import LogEntry

PATIENCE_NS: Final = 3_000_000_000
"""Maximum wait of entries for a logger that does not report; each reports once per second."""


class _Logger(msgspec.Struct):
    complete_utc_ns: int
    """All entries before this instant have been read."""
    moved_ns: int
    """When `complete_utc_ns` changed last."""


class Interleaving:
    """Holds entries until no logger can deliver an older one.

    A logger writes in batches: entries recorded before `began_utc_ns` may arrive later, and are left out.
    """

    def __init__(self, loggers: Iterable[str], began_utc_ns: int, now_ns: int) -> None:
        self._began_utc_ns = began_utc_ns
        self._loggers = {name: _Logger(began_utc_ns, now_ns) for name in loggers}
        self._held: list[LogEntry] = []

    def on_batch(self, logger: str, entries: Iterable[LogEntry], complete_utc_ns: int, now_ns: int) -> None:
        """Takes a batch of one logger with all its entries before `complete_utc_ns`."""
        state = self._loggers[logger]
        # only the first batch may contain older entries: a wall clock that is set back later must not hide
        # any
        first = state.complete_utc_ns == self._began_utc_ns
        self._held += [entry for entry in entries if not first or entry.utc_ns >= self._began_utc_ns]
        if complete_utc_ns > state.complete_utc_ns:
            state.complete_utc_ns = complete_utc_ns
            state.moved_ns = now_ns

    def ready(self, now_ns: int) -> list[LogEntry]:
        """Entries in order that no older entry can precede any more."""
        waited_for = self._waited_for(now_ns)
        # None if every logger is silent for too long: then nothing is worth waiting for
        until_ns = min((logger.complete_utc_ns for logger in waited_for), default=None)
        ready = [entry for entry in self._held if until_ns is None or entry.utc_ns < until_ns]
        if ready:
            self._held = [entry for entry in self._held if until_ns is not None and entry.utc_ns >= until_ns]
        return sorted(ready, key=_by_utc)

    def deadline_ns(self, now_ns: int) -> int | None:
        """When `ready` may return more without a batch, or None if no entries wait."""
        if not self._held:
            return None
        return min((logger.moved_ns + PATIENCE_NS for logger in self._waited_for(now_ns)), default=now_ns)

    def _waited_for(self, now_ns: int) -> list[_Logger]:
        return [logger for logger in self._loggers.values() if now_ns < logger.moved_ns + PATIENCE_NS]


def _by_utc(entry: LogEntry) -> int:
    return entry.utc_ns
