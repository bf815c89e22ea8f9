"""One MCAP file of the local ring: whole records at a time, readable while it grows and after a cut."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
from mcap.writer import Writer

from swarmware import __version__
from swarmware.record.entry import Entry, schema

MAGIC: Final = b"\x89MCAP0\r\n"
_RECORD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_CHANNEL, _MESSAGE_OPCODE, _METADATA, _DATA_END, _FOOTER = 0x04, 0x05, 0x0C, 0x0F, 0x02
_TAIL: Final = (
    _RECORD.pack(_DATA_END, 4) + bytes(4) + _RECORD.pack(_FOOTER, 20) + bytes(20) + MAGIC
)  # a valid end without a summary: what a cut file gets
_U64: Final = 1 << 64
_BUFFER_BYTES: Final = 1 << 20

COUNTERS: Final = "swarm.queues"
"""Name of the metadata record at the start of each segment: the sequence of every queue so far."""


class Channel(msgspec.Struct, frozen=True, gc=False):
    """What all entries of one resource have in common."""

    platform: str
    path: str
    kind: str
    type: str
    queue: str


class SegmentWriter:
    """Appends entries to one MCAP file.

    The file is not chunked: every record stands by itself, so a cut at any byte loses nothing
    that was flushed before it.
    """

    def __init__(self, path: Path, counters: dict[str, int]) -> None:
        self.path = path
        self._file: BinaryIO = path.open("xb", buffering=_BUFFER_BYTES)
        self._writer: Any = Writer(self._file, use_chunking=False)
        self._writer.start(profile="", library=f"swarmware {__version__}")
        self._writer.add_metadata(COUNTERS, {queue: str(number) for queue, number in counters.items()})
        self._channels: dict[Channel, int] = {}
        self._schemas: dict[str, int] = {}
        self.bytes = 0
        """Bytes of payload and record headers so far."""

    def append(self, channel: Channel, sequence: int, stamp_ns: int, utc_ns: int, payload: bytes) -> None:
        """Adds one entry; it is in the file after `flush`."""
        number = self._channels.get(channel)
        if number is None:
            number = self._register(channel)
        self._writer.add_message(number, utc_ns, payload, stamp_ns % _U64, sequence)
        self.bytes += len(payload) + _RECORD.size + _MESSAGE.size

    def _register(self, channel: Channel) -> int:
        schema_id = self._schemas.get(channel.type)
        if schema_id is None:
            data = schema(channel.type)
            schema_id = self._writer.register_schema(channel.type, "jsonschema", data) if data else 0
            self._schemas[channel.type] = schema_id
        number: int = self._writer.register_channel(
            f"/{channel.platform}/{channel.path}",
            "msgpack",
            schema_id,
            {"kind": channel.kind, "type": channel.type, "queue": channel.queue, "clock": channel.platform},
        )
        self._channels[channel] = number
        return number

    def flush(self) -> int:
        """Hands everything to the operating system; the size of the file then."""
        self._file.flush()
        return self._file.tell()

    def fileno(self) -> int:
        """For fsync."""
        return self._file.fileno()

    def close(self) -> None:
        """Ends the file with the summary that makes other tools fast."""
        if not self._file.closed:
            self._writer.finish()
            self._file.close()


class SegmentReader:
    """Reads the entries of one segment from its start, also while it is being written.

    `offset` stands behind the last whole record read: reading goes on there later.
    """

    def __init__(self, path: Path, offset: int = 0) -> None:
        self.path = path
        self.offset = len(MAGIC)
        self.counters: dict[str, int] = {}
        """Sequence of each queue when the segment began."""
        self.ended = False
        """Whether the end of the data was seen."""
        self._channels: dict[int, Channel] = {}
        self._resume = offset
        """Entries before it are skipped, channels are not: they are needed."""

    def entries(self) -> Iterator[Entry]:
        """Entries that are complete in the file now."""
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                return
            file.seek(self.offset)
            while True:
                head = file.read(_RECORD.size)
                if len(head) < _RECORD.size:
                    return
                opcode, length = _RECORD.unpack(head)
                body = file.read(length) if length < 1 << 32 else b""
                if len(body) < length:
                    return
                if opcode in (_DATA_END, _FOOTER):
                    self.ended = True
                    return
                start = self.offset
                self.offset += _RECORD.size + length
                if opcode == _MESSAGE_OPCODE:
                    if start >= self._resume and (entry := self._entry(body)) is not None:
                        yield entry
                elif opcode == _CHANNEL:
                    self._add_channel(body)
                elif opcode == _METADATA:
                    self._read_counters(body)

    def _entry(self, body: bytes) -> Entry | None:
        number, sequence, utc_ns, stamp_ns = _MESSAGE.unpack_from(body)
        channel = self._channels.get(number)
        if channel is None:
            return None
        return Entry(
            channel.queue,
            sequence,
            channel.platform,
            channel.path,
            channel.kind,
            channel.type,
            stamp_ns if stamp_ns < _U64 // 2 else stamp_ns - _U64,
            utc_ns,
            body[_MESSAGE.size :],
        )

    def _add_channel(self, body: bytes) -> None:
        number = int.from_bytes(body[0:2], "little")
        topic, at = _text(body, 4)
        _, at = _text(body, at)
        metadata = _map(body, at)
        platform, _, path = topic.removeprefix("/").partition("/")
        self._channels[number] = Channel(
            platform,
            path,
            metadata.get("kind", "board"),
            metadata.get("type", ""),
            metadata.get("queue", f"{platform}:unknown:out"),
        )

    def _read_counters(self, body: bytes) -> None:
        name, at = _text(body, 0)
        if name == COUNTERS:
            self.counters = {queue: int(number) for queue, number in _map(body, at).items()}


def repair(path: Path) -> int:
    """Gives a segment that was cut a valid end; how many bytes of a half-written record went.

    A file without a whole header record is removed.
    """
    reader = SegmentReader(path)
    for _ in reader.entries():
        pass
    size = path.stat().st_size
    if reader.ended and _has_end(path):
        return 0
    if reader.offset == len(MAGIC):
        path.unlink()
        return size
    with path.open("r+b") as file:
        file.truncate(reader.offset)
        file.seek(0, 2)
        file.write(_TAIL)
    return 0 if reader.ended else size - reader.offset


def _has_end(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-len(MAGIC), 2)
        return file.read() == MAGIC


def _text(body: bytes, at: int) -> tuple[str, int]:
    length = int.from_bytes(body[at : at + 4], "little")
    return body[at + 4 : at + 4 + length].decode("utf-8", "replace"), at + 4 + length


def _map(body: bytes, at: int) -> dict[str, str]:
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    at += 4
    out: dict[str, str] = {}
    while at < min(end, len(body)):
        key, at = _text(body, at)
        out[key], at = _text(body, at)
    return out
