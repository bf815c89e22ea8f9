"""Writer of an MCAP file without chunks, byte for byte as `mcap.writer.Writer` writes it.

That one loads `importlib.metadata`, mail, archives and LZ4: 3 MB of resident memory in each logger; and
makes an object of each message. Source: MCAP specification, version 0.
"""

import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Final, Protocol

from swarmware.recorder.scan import (
    CHANNEL,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_OPCODE,
    METADATA,
    METADATA_INDEX,
    RECORD,
    SCHEMA,
)

_CHUNK_INDEX: Final = 0x08
_ATTACHMENT_INDEX: Final = 0x0A
_STATISTICS: Final = 0x0B
_SUMMARY_OFFSET: Final = 0x0E
_STATISTICS_HEAD: Final = struct.Struct("<QHIIIIQQ")
_COUNT: Final = struct.Struct("<HQ")
_OFFSET: Final = struct.Struct("<BQQ")
_PLACE: Final = struct.Struct("<QQ")
_MESSAGE_HEAD: Final = struct.Struct("<BQ" + MESSAGE.format.removeprefix("<"))


class ByteSink(Protocol):
    """Output of an MCAP file."""

    def write(self, data: bytes, /) -> object:
        """Append the data at the end."""

    def tell(self) -> int:
        """Number of bytes so far."""


def channel_record(number: int, schema: int, topic: str, metadata: Mapping[str, str]) -> bytes:
    """The record of a channel with messages in MessagePack."""
    head = struct.pack("<HH", number, schema)
    return _record(CHANNEL, head + _text(topic) + _text("msgpack") + _map(metadata))


class McapWriter:
    """Writes records in order, and an index of them at the end. The header is written at once."""

    def __init__(self, out: ByteSink, library: str) -> None:
        self._out = out
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._metadata: list[bytes] = []
        """Index records of the metadata."""
        self._counts: dict[int, int] = {}
        """Number of messages by channel."""
        self._first_ns = 0
        self._last_ns = 0
        out.write(MAGIC + _record(HEADER, _text("") + _text(library)))

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write one metadata record."""
        record = _record(METADATA, _text(name) + _map(data))
        index = _PLACE.pack(self._out.tell(), len(record)) + _text(name)
        self._metadata.append(_record(METADATA_INDEX, index))
        self._out.write(record)

    def register_schema(self, name: str, data: bytes) -> int:
        """Write a JSON Schema; returns its number."""
        number = len(self._schemas) + 1
        body = (
            struct.pack("<H", number)
            + _text(name)
            + _text("jsonschema")
            + struct.pack("<I", len(data))
            + data
        )
        self._schemas.append(_record(SCHEMA, body))
        self._out.write(self._schemas[-1])
        return number

    def register_channel(self, schema: int, topic: str, metadata: Mapping[str, str]) -> int:
        """Write a channel; returns its number. `schema`: its number, 0 for none."""
        number = len(self._channels) + 1
        self._channels.append(channel_record(number, schema, topic, metadata))
        self._out.write(self._channels[-1])
        return number

    def add_message(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Write a message of a channel."""
        if not self._counts or log_ns < self._first_ns:
            self._first_ns = log_ns
        self._last_ns = max(self._last_ns, log_ns)
        self._counts[channel] = self._counts.get(channel, 0) + 1
        size = MESSAGE.size + len(data)
        self._out.write(
            _MESSAGE_HEAD.pack(MESSAGE_OPCODE, size, channel, sequence, log_ns, publish_ns) + data
        )

    def finish(self) -> None:
        """Write the end of the data, the summary and the end of the file."""
        self._out.write(_record(DATA_END, bytes(4)))
        start = self._out.tell()
        groups: tuple[tuple[int, Iterable[bytes]], ...] = (
            (SCHEMA, self._schemas),
            (CHANNEL, self._channels),
            (_STATISTICS, [self._statistics()]),
            (_CHUNK_INDEX, ()),
            (_ATTACHMENT_INDEX, ()),
            (METADATA_INDEX, self._metadata),
        )
        summary, offsets = bytearray(), bytearray()
        for opcode, records in groups:
            group = b"".join(records)
            offsets += _record(_SUMMARY_OFFSET, _OFFSET.pack(opcode, start + len(summary), len(group)))
            summary += group
        places = _PLACE.pack(start, start + len(summary))
        summary += offsets
        footer = RECORD.pack(FOOTER, len(places) + 4) + places
        check = zlib.crc32(footer, zlib.crc32(summary))
        self._out.write(bytes(summary) + footer + struct.pack("<I", check) + MAGIC)

    def _statistics(self) -> bytes:
        head = _STATISTICS_HEAD.pack(
            sum(self._counts.values()),
            len(self._schemas),
            len(self._channels),
            0,
            len(self._metadata),
            0,
            self._first_ns,
            self._last_ns,
        )
        counts = b"".join(_COUNT.pack(channel, count) for channel, count in self._counts.items())
        return _record(_STATISTICS, head + struct.pack("<I", len(counts)) + counts)


def _record(opcode: int, body: bytes) -> bytes:
    return RECORD.pack(opcode, len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _map(data: Mapping[str, str]) -> bytes:
    body = b"".join(_text(key) + _text(value) for key, value in data.items())
    return struct.pack("<I", len(body)) + body
