"""Streams of untyped MessagePack: pipes, spool files, logs of other systems."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, BinaryIO, Final

import msgpack

from swarmware.errors import WireError
from swarmware.frame import PAYLOAD_LIMIT
from swarmware.record.entry import Entry
from swarmware.record.query import Filter, Query

FOREIGN: Final = "foreign"
"""Platform under which values stand that are no entries of ours: `/foreign/spool`."""

_KEYS: Final = Entry.__struct_fields__


def write(entries: Iterable[Entry], file: BinaryIO) -> int:
    """Writes entries one after the other; how many there were."""
    packer = msgpack.Packer()
    count = 0
    for entry in entries:
        file.write(packer.pack({key: getattr(entry, key) for key in _KEYS}))
        count += 1
    return count


class SpoolSource:
    """Entries of a stream, in its order; any other MessagePack value is an entry of `/foreign/spool`."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._file = file
        self._name = name

    def entries(self, query: Query) -> Iterator[Entry]:
        """Entries that answer the query.

        Raises: WireError naming the byte at which the stream is no MessagePack.
        """
        found = filter(Filter(query), self._read())
        if query.newest and query.limit is not None:
            return iter(deque(found, maxlen=query.limit))
        return islice(found, query.limit)

    def losses(self) -> list[str]:
        """None: an answer is whole, or an error."""
        return []

    def nothing(self) -> str:
        """A stream may be empty."""
        return ""

    def _read(self) -> Iterator[Entry]:
        unpacker = msgpack.Unpacker(self._file, max_buffer_size=4 * PAYLOAD_LIMIT, strict_map_key=False)
        number = 1
        while True:
            try:
                entry = _entry(unpacker.unpack(), number)
            except msgpack.OutOfData:
                return
            except (ValueError, TypeError, msgpack.exceptions.UnpackException, RecursionError) as error:
                reason = str(error) or type(error).__name__
                raise WireError(f"{self._name}: byte {unpacker.tell()}: no MessagePack: {reason}") from error
            number += 1
            yield entry


def _entry(value: Any, number: int) -> Entry:
    if isinstance(value, dict) and value.keys() | {"sender"} == set(_KEYS):
        found = Entry(**value)
        if all(isinstance(getattr(found, key), kind) for key, kind in Entry.__annotations__.items()):
            return found
    payload = msgpack.packb(value)
    return Entry(f"{FOREIGN}:spool:in", number, FOREIGN, "spool", "event", "", 0, 0, payload)
