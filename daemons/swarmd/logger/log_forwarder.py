"""Store and forward: copies each entry of the local log ring to MongoDB once, and records losses as gaps."""

from pathlib import Path
from typing import Final, Protocol

from swarmware.recorder.entry import Cursor, LogEntry
from swarmware.recorder.ring import segments
from swarmware.recorder.segment import SegmentReader
from swarmware.types import registry
from swarmware.types.log import GapCause, LogGap

BATCH_BYTES: Final = 4 << 20
"""Maximum payload of a batch of several entries, which bounds the memory while the database is slow."""


class LogStore(Protocol):
    """The destination of forwarded entries."""

    def prepare(self) -> None:
        """Creates the indexes before the first entry."""
        ...

    def cursor(self, platform: str) -> Cursor:
        """Position in the platform's ring up to which entries are stored."""
        ...

    def write(self, entries: list[LogEntry], platform: str, cursor: Cursor) -> None:
        """Stores entries idempotently, then the cursor."""
        ...


class LogForwarder:
    """Forwards the ring of one platform; every call may block, and belongs in a thread.

    After an error of the store, forwarding resumes at the cursor of the store. An entry that is then stored
    twice overwrites its own slot.
    """

    def __init__(self, directory: Path, platform: str, store: LogStore, batch: int) -> None:
        self._directory = directory
        self._platform = platform
        self._store = store
        self._batch = batch
        self._size = batch
        self._cursor: Cursor | None = None
        self._reader: SegmentReader | None = None
        self._end_lost = False
        """True if the end of the previous segment was unreadable, so that missing entries count as
        damaged."""
        self.forwarded = 0
        """Entries stored since the start."""
        self.gaps = 0
        """Entries that the ring overwrote before they were forwarded."""

    def step(self) -> int:
        """Forwards the next batch; returns its number of entries, or 0 if all entries are stored.

        Raises: the errors of the store; the next call repeats the batch.
        """
        try:
            if self._cursor is None:
                self._store.prepare()
                self._cursor = self._store.cursor(self._platform)
                self._reader = None
            return self._forward(self._cursor)
        except BaseException:
            self._cursor = None
            raise

    def backlog(self, counters: dict[str, int]) -> int:
        """Number of entries in the ring that are not stored yet."""
        stored = self._cursor.sequences if self._cursor is not None else {}
        return sum(max(0, last - stored.get(queue, 0)) for queue, last in counters.items())

    def _forward(self, cursor: Cursor) -> int:
        while (reader := self._segment(cursor)) is not None:
            number = int(reader.path.stem)
            # checked before reading, so that entries written after the check are not skipped with this
            # segment
            complete = self._has_newer(number)
            try:
                entries = self._next_batch(reader)
            except FileNotFoundError:
                entries, complete = [], True  # the ring deleted the segment while it was read
            if entries:
                sequences = dict(cursor.sequences)
                where = GapCause.DAMAGED if reader.damaged or self._end_lost else GapCause.OVERWRITTEN
                documents = self._with_gaps(entries, sequences, where)
                moved = Cursor(number, reader.offset, sequences)
                self._write(documents, moved)
                self._cursor = moved
                self.forwarded += len(entries)
                return len(entries)
            if not complete:
                return 0
            self._end_lost = reader.lost_end_bytes > 0
            cursor = self._cursor = Cursor(number + 1, 0, cursor.sequences)
        return 0

    def _next_batch(self, reader: SegmentReader) -> list[LogEntry]:
        entries: list[LogEntry] = []
        room = BATCH_BYTES * self._size // self._batch
        for entry in reader.entries():
            entries.append(entry)
            room -= len(entry.payload)
            if room <= 0 or len(entries) == self._size:
                break
        return entries

    def _write(self, documents: list[LogEntry], moved: Cursor) -> None:
        """Stores a batch; a failure halves the batch size, because a slow link may not carry it in time."""
        try:
            self._store.write(documents, self._platform, moved)
        except BaseException:
            self._size = max(1, self._size // 2)
            raise
        self._size = min(self._batch, self._size * 2)

    def _segment(self, cursor: Cursor) -> SegmentReader | None:
        if self._reader is not None and int(self._reader.path.stem) == cursor.segment:
            return self._reader
        for path in segments(self._directory):
            number = int(path.stem)
            # the segment of the cursor may have been deleted: the ring then continues with a later one
            if number >= cursor.segment:
                self._reader = SegmentReader(path, cursor.offset if number == cursor.segment else 0)
                return self._reader
        return None

    def _has_newer(self, number: int) -> bool:
        paths = segments(self._directory)
        return bool(paths) and int(paths[-1].stem) > number

    def _with_gaps(
        self, entries: list[LogEntry], sequences: dict[str, int], where: GapCause
    ) -> list[LogEntry]:
        out: list[LogEntry] = []
        for entry in entries:
            expected = sequences.get(entry.queue, 0) + 1
            if entry.sequence > expected:
                out.append(self._gap(entry, expected, sequences, where))
            # an entry that was forwarded before must not move the counter back
            sequences[entry.queue] = max(entry.sequence, expected - 1)
            out.append(entry)
        return out

    def _gap(self, entry: LogEntry, expected: int, sequences: dict[str, int], where: GapCause) -> LogEntry:
        missing = entry.sequence - expected
        self.gaps += missing
        queue = f"{self._platform}:upload:gaps"
        sequences[queue] = sequences.get(queue, 0) + 1
        gap = LogGap(where, entry.queue, "", missing, expected, entry.sequence - 1)
        return LogEntry(
            queue,
            sequences[queue],
            self._platform,
            "log/gaps",
            "event",
            registry.type_name(LogGap),
            entry.stamp_ns,
            entry.utc_ns,
            registry.encode(gap),
        )
