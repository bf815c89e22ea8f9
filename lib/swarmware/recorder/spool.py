"""Streams of untyped MessagePack: pipes, spool files, logs of other systems."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, BinaryIO, Final

import msgpack

from swarmware.errors import WireError
from swarmware.model.foreign_format import HEAD_BYTES, foreign_format
from swarmware.model.frame import PAYLOAD_LIMIT
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import Filter, Query

FOREIGN: Final = "foreign"
"""Platform of the values that are not log entries: `/foreign/spool`."""

EXPORT: Final = "`swarmctl log export --format msgpack`"
"""Command that writes such streams."""
_KEYS: Final = LogEntry.__struct_fields__
_OPTIONAL: Final = {"sender", "sent_utc_ns", "description"}


def write(entries: Iterable[LogEntry], file: BinaryIO) -> int:
    """Writes all entries; their number."""
    packer = msgpack.Packer()
    count = 0
    for entry in entries:
        file.write(packer.pack({key: getattr(entry, key) for key in _KEYS}))
        count += 1
    return count


class SpoolSource:
    """Entries of a stream, in its order; any other MessagePack value becomes an entry of `/foreign/spool`."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._file = file
        self._name = name

    def entries(self, query: Query) -> Iterator[LogEntry]:
        """Entries that match the query.

        Raises: WireError with the offset of the first byte that is not MessagePack, or for a file of another
        tool.
        """
        found = filter(Filter(query), self._read())
        if query.newest and query.limit is not None:
            return iter(deque(found, maxlen=query.limit))
        return islice(found, query.limit)

    def losses(self) -> list[str]:
        """Always empty: a query succeeds completely or raises."""
        return []

    def why_empty(self) -> str:
        """Always empty: a stream without entries is valid."""
        return ""

    def _read(self) -> Iterator[LogEntry]:
        head = self._file.read(HEAD_BYTES)
        if what := foreign_format(head):
            raise WireError(f"{self._name}: {what}: not readable here; expected MessagePack of {EXPORT}")
        stream = _Rejoined(head, self._file)
        unpacker = msgpack.Unpacker(stream, max_buffer_size=4 * PAYLOAD_LIMIT, strict_map_key=False)
        number = 1
        while True:
            try:
                entry = _entry(unpacker.unpack(), number)
            except msgpack.OutOfData:
                return
            except (ValueError, TypeError, msgpack.exceptions.UnpackException, RecursionError) as error:
                reason = str(error) or type(error).__name__
                raise WireError(
                    f"{self._name}: byte {unpacker.tell()}: invalid MessagePack: {reason};"
                    f" expected the form of {EXPORT}"
                ) from error
            number += 1
            yield entry


class _Rejoined:
    """A stream whose first bytes were read already."""

    def __init__(self, head: bytes, rest: BinaryIO) -> None:
        self._head = head
        self._rest = rest

    def read(self, size: int) -> bytes:
        """The next bytes, or b"" at the end."""
        found, self._head = self._head[:size], self._head[size:]
        return found or self._rest.read(size)


def _entry(value: Any, number: int) -> LogEntry:
    if isinstance(value, dict) and value.keys() | _OPTIONAL == set(_KEYS):
        found = LogEntry(**value)
        if all(isinstance(getattr(found, key), kind) for key, kind in LogEntry.__annotations__.items()):
            return found
    # Not an entry of this export: kept with its payload as a foreign one.
    payload = msgpack.packb(value)
    return LogEntry(f"{FOREIGN}:spool:in", number, FOREIGN, "spool", "event", "", 0, 0, payload)
