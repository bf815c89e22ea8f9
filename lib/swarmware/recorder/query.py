"""One query interface over the local ring, a report folder and MongoDB."""

import heapq
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Protocol

import msgspec

from swarmware.errors import NotFound
from swarmware.model import names
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.foreign_log import foreign_log, refuse_foreign
from swarmware.recorder.ring import segments, set_aside
from swarmware.recorder.segment import SegmentReader


class Query(msgspec.Struct, frozen=True, kw_only=True):
    """Selection of log entries: paths, types, time window, number."""

    pattern: str = "/**"
    """Global paths, such as /uav*/nav/pose."""
    types: tuple[str, ...] = ()
    """Type names; () selects all."""
    since_ns: int | None = None
    """UTC in ns, inclusive."""
    until_ns: int | None = None
    """UTC in ns, exclusive."""
    limit: int | None = None
    """Maximum number of entries; the newest ones when `newest` is set, else the oldest."""
    newest: bool = False


class QueueStats(msgspec.Struct, frozen=True):
    """Statistics of one queue of a source."""

    queue: str
    entries: int
    bytes: int
    first_sequence: int
    last_sequence: int
    first_utc_ns: int
    last_utc_ns: int
    missing: int
    """Sequence numbers between first and last that are missing."""


class LogSource(Protocol):
    """Source of log entries: a folder, a database, a stream."""

    def entries(self, query: Query) -> Iterator[LogEntry]:
        """Entries that match the query, sorted by UTC."""
        ...

    def losses(self) -> list[str]:
        """Data that could not be read during the last `entries`, each with its place."""
        ...

    def why_empty(self) -> str:
        """Reason why the source has no entries at all, or "" if it has some."""
        ...


class FolderSource:
    """Entries in folders of MCAP segments: the ring of a node, or the logs of a report."""

    def __init__(self, directories: Iterable[Path]) -> None:
        self.directories = tuple(directories)
        self._damage: dict[Path, str] = {}
        self._foreign: dict[Path, str] = {}
        """Files of other programs between the segments."""
        for directory in self.directories:
            if not directory.is_dir():
                refuse_foreign(directory)
                raise NotFound(f"log folder {directory}: no such directory; expected one with .mcap segments")

    def entries(self, query: Query) -> Iterator[LogEntry]:
        """Entries that match the query, sorted by UTC.

        Raises: InvalidInput when the folders have nothing but logs of other programs.
        """
        wanted = Filter(query)
        # again for each query: files may have come, and former damage may be gone
        self._foreign = self._found_foreign()
        self._damage = {
            path: "no readable record" for directory in self.directories for path in set_aside(directory)
        }
        self._damage |= {path: f"{what}: not readable here" for path, what in self._foreign.items()}
        # read backwards and stopped early: a log of days is not read for its last entries
        if query.newest and query.limit is not None:
            last = [self._newest(directory, wanted, query.limit) for directory in self.directories]
            return iter(list(heapq.merge(*last, key=_by_utc))[-query.limit :])
        runs = [filter(wanted, self._folder(directory)) for directory in self.directories]
        return islice(heapq.merge(*runs, key=_by_utc), query.limit)

    def _found_foreign(self) -> dict[Path, str]:
        own = [path for directory in self.directories for path in segments(directory)]
        found = {path: what for path in own if (what := foreign_log(path))}
        # own segments beside foreign files are read; foreign files alone are an error
        if len(found) == len(own):
            for directory in self.directories:
                refuse_foreign(directory)
        return found

    def _newest(self, directory: Path, wanted: "Filter", limit: int) -> list[LogEntry]:
        """The newest matching entries; segments are read from the newest back, until there are enough."""
        found: list[LogEntry] = []
        for path in reversed(segments(directory)):
            found = [*deque(filter(wanted, self._segment(path)), maxlen=limit - len(found)), *found]
            if len(found) == limit:
                break
        return found

    def losses(self) -> list[str]:
        """Segments with unreadable parts."""
        return [f"{path}: {what}" for path, what in sorted(self._damage.items())]

    def why_empty(self) -> str:
        """Reports folders without segments."""
        if any(segments(directory) for directory in self.directories):
            return ""
        return f"nothing is recorded in {', '.join(map(str, self.directories)) or 'any folder'}"

    def _folder(self, directory: Path) -> Iterator[LogEntry]:
        for path in segments(directory):
            yield from self._segment(path)

    def _segment(self, path: Path) -> Iterator[LogEntry]:
        if path in self._foreign:
            return
        reader = SegmentReader(path)
        try:
            yield from reader.entries()
        except FileNotFoundError:
            return  # the ring deleted this segment, its oldest, during the read
        except OSError as error:
            self._damage[path] = f"cannot be read: {error.strerror}"
            return
        found = []
        if reader.damaged:
            places = "1 place" if reader.damaged == 1 else f"{reader.damaged} places"
            found.append(f"{places} damaged, {reader.damaged_bytes} bytes skipped")
        # the segment that is being written has no end yet, which is not damage
        if not (reader.ended or reader.growing):
            lost = (
                f", its last {reader.lost_end_bytes} bytes have no entries" if reader.lost_end_bytes else ""
            )
            found.append(f"its end is missing{lost}")
        if found:
            self._damage[path] = "; ".join(found)


class Filter:
    """A compiled query: a predicate over entries."""

    def __init__(self, query: Query) -> None:
        self._query = query
        self._pattern = names.Pattern(query.pattern)
        self._topics: dict[tuple[str, str], bool] = {}

    def __call__(self, entry: LogEntry) -> bool:
        query = self._query
        if query.since_ns is not None and entry.utc_ns < query.since_ns:
            return False
        if query.until_ns is not None and entry.utc_ns >= query.until_ns:
            return False
        if query.types and entry.type not in query.types:
            return False
        key = (entry.platform, entry.path)
        # paths repeat for every entry, so each is matched once
        matches = self._topics.get(key)
        if matches is None:
            matches = self._topics[key] = self._pattern.matches(entry.topic)
        return matches


def stats(entries: Iterable[LogEntry]) -> list[QueueStats]:
    """Statistics of each queue, sorted by name."""
    seen: dict[str, list[LogEntry]] = {}
    sizes: dict[str, int] = {}
    sequences: dict[str, set[int]] = {}
    for entry in entries:
        ends = seen.setdefault(entry.queue, [entry, entry])
        ends[1] = entry
        sizes[entry.queue] = sizes.get(entry.queue, 0) + len(entry.payload)
        sequences.setdefault(entry.queue, set()).add(entry.sequence)
    return [
        QueueStats(
            queue,
            len(sequences[queue]),
            sizes[queue],
            min(sequences[queue]),
            max(sequences[queue]),
            first.utc_ns,
            last.utc_ns,
            max(sequences[queue]) - min(sequences[queue]) + 1 - len(sequences[queue]),
        )
        for queue, (first, last) in sorted(seen.items())
    ]


def _by_utc(entry: LogEntry) -> int:
    return entry.utc_ns
