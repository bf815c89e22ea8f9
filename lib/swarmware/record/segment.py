"""One MCAP file of the local ring: whole records at a time, readable while it grows and after any damage."""

import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
from mcap.writer import Writer

from swarmware import __version__
from swarmware.record.entry import Entry, schema
from swarmware.record.scan import (
    CHANNEL,
    DATA_END,
    FOOTER,
    LENGTHS,
    MAGIC,
    MESSAGE,
    MESSAGE_OPCODE,
    METADATA,
    METADATA_INDEX,
    RECORD,
    Record,
    Scan,
    has_end,
)

TAIL: Final = (
    RECORD.pack(DATA_END, 4) + bytes(4) + RECORD.pack(FOOTER, 20) + bytes(20) + MAGIC
)  # a valid end without a summary: what a cut file gets
_I64: Final = 1 << 63
_U64: Final = 1 << 64
BUFFER_LIMIT: Final = 32 << 20
"""Bytes that wait in memory for a disk that does not take them; then entries are lost, and counted."""

COUNTERS: Final = "swarm.queues"
"""Name of the metadata record at the start of each segment: the sequence of every queue so far."""
STAMPS: Final = "swarm.stamps"
"""The same for the newest stamp of every path."""
FINAL: Final = "swarm.end."
"""Prefix of both at the end of a segment that was ended: a start need not read what lies between."""
CHECK: Final = "check"
"""Key of the checksum that a channel and a metadata record carry: the one decides about many entries."""
_SMALLEST: Final = RECORD.size + MESSAGE.size


class Channel(msgspec.Struct, frozen=True, gc=False):
    """What all entries of one resource have in common."""

    platform: str
    path: str
    kind: str
    type: str
    queue: str
    sender: str = ""
    """Who sends them, of commands."""


class Full(OSError):
    """The disk has not taken anything for so long that no more entries are kept in memory."""


class AppendBuffer:
    """The end of the file: what is written waits in memory until the disk has taken all of it.

    A disk that takes a part only, or nothing, leaves no half record: the same bytes are written to the same
    place again.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._waiting = bytearray()
        self._on_disk = 0

    def write(self, data: bytes) -> int:
        """Takes the bytes."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Length of the file when all is written."""
        return self._on_disk + len(self._waiting)

    @property
    def waiting(self) -> int:
        """Bytes that the disk has not taken."""
        return len(self._waiting)

    def flush(self) -> None:
        """Writes what waits. Raises: OSError; nothing is lost then."""
        view = memoryview(self._waiting)
        try:
            at = 0
            while at < len(view):
                at += os.pwrite(self._fd, view[at:], self._on_disk + at)
        finally:
            view.release()
        self._on_disk += len(self._waiting)
        self._waiting.clear()

    def sync(self) -> None:
        """Until it survives a loss of power."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Gives the file back; what still waits is lost."""
        fd, self._fd = self._fd, -1  # given back even when closing says that something went wrong
        if fd >= 0:
            os.close(fd)


class SegmentWriter:
    """Appends entries to one MCAP file.

    The file is not chunked: every record stands by itself, so a cut at any byte loses nothing
    that was flushed before it.
    """

    def __init__(
        self, path: Path, counters: Mapping[str, int], stamps: Mapping[str, int] | None = None
    ) -> None:
        self.path = path
        self._out = AppendBuffer(path)
        out: Any = self._out  # of a file it needs no more than this
        self._writer: Any = Writer(out, use_chunking=False)
        self._writer.start(profile="", library=f"swarmware {__version__}")
        self._add_numbers(COUNTERS, counters)
        self._add_numbers(STAMPS, stamps or {})
        self._channels: dict[Channel, int] = {}
        self._schemas: dict[str, int] = {}
        self._closed = False
        self.bytes = 0
        """Bytes of payload and record headers so far."""

    def _add_numbers(self, name: str, numbers: Mapping[str, int]) -> None:
        data = {key: str(number) for key, number in numbers.items()}
        self._writer.add_metadata(name, data | {CHECK: _check(data, name)})

    def append(self, channel: Channel, sequence: int, stamp_ns: int, utc_ns: int, payload: bytes) -> None:
        """Adds one entry; it is in the file after `flush`.

        Raises: Full when the disk has not taken what came before.
        """
        if self._out.waiting > BUFFER_LIMIT:
            raise Full(f"{self.path}: {self._out.waiting} bytes wait for the disk")
        number = self._channels.get(channel)
        copy = b""
        if number is None:
            number, copy = self._register(channel)
        self._writer.add_message(number, utc_ns, payload, stamp_ns % _U64, sequence)
        self._out.write(copy)
        self.bytes += len(payload) + _SMALLEST

    def _register(self, channel: Channel) -> tuple[int, bytes]:
        """Number, and a second copy of the record: a damaged one would take all entries of its resource."""
        schema_id = self._schemas.get(channel.type)
        if schema_id is None:
            data = schema(channel.type)
            schema_id = self._writer.register_schema(channel.type, "jsonschema", data) if data else 0
            self._schemas[channel.type] = schema_id
        topic = f"/{channel.platform}/{channel.path}"
        metadata = {
            "kind": channel.kind,
            "type": channel.type,
            "queue": channel.queue,
            "clock": channel.platform,
        }
        if channel.sender:
            metadata["sender"] = channel.sender
        metadata[CHECK] = _check(metadata, topic)
        number: int = self._writer.register_channel(topic, "msgpack", schema_id, metadata)
        self._channels[channel] = number
        return number, _channel_record(number, schema_id, topic, metadata)

    @property
    def waiting(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._out.waiting

    def flush(self) -> int:
        """Hands everything to the operating system; the size of the file then."""
        self._out.flush()
        return self._out.tell()

    def sync(self) -> None:
        """Until what was flushed survives a loss of power."""
        self._out.sync()

    def finish(self, counters: Mapping[str, int], stamps: Mapping[str, int]) -> None:
        """Ends the data with how far its queues came, the file with the summary that makes tools fast."""
        if not self._closed:
            self._closed = True
            self._add_numbers(FINAL + COUNTERS, counters)
            self._add_numbers(FINAL + STAMPS, stamps)
            self._writer.finish()

    def close(self) -> None:
        """Writes what waits and gives the file back. Raises: OSError when the disk does not take it."""
        try:
            if not self._closed:
                self._closed = True
                self._writer.finish()
            self._out.flush()
        finally:
            self._out.close()


class SegmentReader:
    """Reads the entries of one segment from its start, also while it is being written.

    `offset` stands behind the last whole record read: reading goes on there later. What is damaged is
    passed over and counted.
    """

    def __init__(self, path: Path, offset: int = 0) -> None:
        self.path = path
        self.offset = len(MAGIC)
        self.counters: dict[str, int] = {}
        """Sequence of each queue when the segment began; after `final` when it ended."""
        self.stamps: dict[str, int] = {}
        """Newest stamp of each path, likewise."""
        self.sound = False
        """Whether `counters` could be read."""
        self.ended = False
        """Whether the end of the data was seen."""
        self.damaged = 0
        """Places in which records were damaged."""
        self.damaged_bytes = 0
        self.read_bytes = 0
        """Bytes taken from the file so far."""
        self._channels: dict[int, Channel] = {}
        self._sequences: dict[str, int] = {}
        self._room: dict[str, int] = {}
        """Bytes damaged when the last entry of each queue was read: so many can be missing after it."""
        self._summary_read = False
        self._resume = offset
        """Entries before it are skipped, channels are not: they are needed."""

    def entries(self) -> Iterator[Entry]:
        """Entries that are complete in the file now."""
        with self.path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if self.offset == len(MAGIC) and not self.damaged and file.read(len(MAGIC)) != MAGIC[:size]:
                self._count(len(MAGIC))
            scan = Scan(file, size, self.offset)
            passed = 0
            for record in scan:
                if scan.damaged_bytes > passed:
                    self._count(scan.damaged_bytes - passed)
                    passed = scan.damaged_bytes
                self.read_bytes, scan.read_bytes = self.read_bytes + scan.read_bytes, 0
                if record.opcode in (DATA_END, FOOTER):
                    self.ended = True
                    return
                self.offset = record.end
                if record.opcode == MESSAGE_OPCODE:
                    entry = self._entry(record, file, size)
                    if entry is not None and record.start >= self._resume:
                        yield entry
                elif record.opcode == CHANNEL:
                    self._add_channel(record.body)
                elif record.opcode == METADATA:
                    self._read_numbers(record.body)
            self.read_bytes += scan.read_bytes

    def _count(self, length: int) -> None:
        self.damaged += 1
        self.damaged_bytes += length

    def _entry(self, record: Record, file: BinaryIO, size: int) -> Entry | None:
        number, sequence, utc_ns, stamp_ns = MESSAGE.unpack_from(record.body)
        channel = self._channels.get(number)
        if channel is None and not self._summary_read:
            self._summary_read = True
            self._channels = _summary_channels(file, size) | self._channels
            channel = self._channels.get(number)
        if channel is None or utc_ns >= _I64:
            self._count(record.end - record.start)
            return None
        return Entry(
            channel.queue,
            self._sequence(channel.queue, sequence, record),
            channel.platform,
            channel.path,
            channel.kind,
            channel.type,
            stamp_ns if stamp_ns < _I64 else stamp_ns - _U64,
            utc_ns,
            record.body[MESSAGE.size :],
            channel.sender,
        )

    def _sequence(self, queue: str, sequence: int, record: Record) -> int:
        """The entry's sequence; a damaged one is put right: only damage makes holes in a queue."""
        last = self._sequences.get(queue)
        if last is None and self.sound:
            last = self.counters.get(queue, 0)
        if last is not None:
            room = (self.damaged_bytes - self._room.get(queue, 0)) // _SMALLEST
            if not last < sequence <= last + 1 + room:
                self._count(record.end - record.start)
                return last + 1  # the next entry tells whether it was this one, or none of the queue
        self._sequences[queue] = sequence
        self._room[queue] = self.damaged_bytes
        return sequence

    def _add_channel(self, body: bytes) -> None:
        found = _channel(body)
        if found is None:
            self._count(RECORD.size + len(body))
        else:
            self._channels.setdefault(*found)

    def _read_numbers(self, body: bytes) -> None:
        found = _numbers(body)
        if found is None:
            self._count(RECORD.size + len(body))
            return
        name, numbers = found
        if name == COUNTERS:
            self.counters, self.sound = numbers, True
        elif name == STAMPS:
            self.stamps = numbers

    def final(self) -> bool:
        """Reads how far the queues had come when the segment was ended; False when it does not say so."""
        with self.path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            places = _summary(file, size, METADATA_INDEX)
            found: dict[str, dict[str, int]] = {}
            for body in places:
                offset, length = int.from_bytes(body[:8], "little"), int.from_bytes(body[8:16], "little")
                if length > size or offset > size:
                    continue
                file.seek(offset)
                numbers = _numbers(file.read(length)[RECORD.size :])
                self.read_bytes += length
                if numbers is not None:
                    found[numbers[0]] = numbers[1]
        if FINAL + COUNTERS not in found:
            return False
        self.counters = found[FINAL + COUNTERS]
        self.stamps = found.get(FINAL + STAMPS, {})
        self.sound = True
        return True


def ended(path: Path) -> bool:
    """Whether the segment was ended, by its writer or by a repair."""
    with path.open("rb") as file:
        return has_end(file, os.fstat(file.fileno()).st_size) is not None


def _summary(file: BinaryIO, size: int, opcode: int) -> list[bytes]:
    """Bodies of the records of one kind in the summary of an ended file."""
    start = has_end(file, size)
    if not start:
        return []
    return [record.body for record in Scan(file, size, start, LENGTHS) if record.opcode == opcode]


def _summary_channels(file: BinaryIO, size: int) -> dict[int, Channel]:
    found = map(_channel, _summary(file, size, CHANNEL))
    return dict(one for one in found if one is not None)


def _channel(body: bytes) -> tuple[int, Channel] | None:
    """Number and channel; None when the record is damaged."""
    number = int.from_bytes(body[0:2], "little")
    try:
        topic, at = _text(body, 4)
        encoding, at = _text(body, at)
        metadata = _map(body, at)
    except ValueError:
        return None
    check = metadata.pop(CHECK, None)
    if encoding != "msgpack" or not number or (check is not None and check != _check(metadata, topic)):
        return None
    platform, _, path = topic.removeprefix("/").partition("/")
    queue = metadata.get("queue", f"{platform}:unknown:out")
    kind, type_name = metadata.get("kind", "board"), metadata.get("type", "")
    return number, Channel(platform, path, kind, type_name, queue, metadata.get("sender", ""))


def _numbers(body: bytes) -> tuple[str, dict[str, int]] | None:
    """Name and content of a metadata record of ours; None when it is damaged."""
    try:
        name, at = _text(body, 0)
        data = _map(body, at)
        check = data.pop(CHECK, None)
        if check is not None and check != _check(data, name):
            return None
        return name, {key: int(number) for key, number in data.items()}
    except ValueError:
        return None


def _check(data: Mapping[str, str], name: str) -> str:
    return f"{zlib.crc32(repr((name, sorted(data.items()))).encode()):08x}"


def _channel_record(number: int, schema_id: int, topic: str, metadata: Mapping[str, str]) -> bytes:
    """Source: MCAP specification, Channel (op=0x04)."""
    pairs = b"".join(_packed(key) + _packed(value) for key, value in metadata.items())
    body = (
        number.to_bytes(2, "little") + schema_id.to_bytes(2, "little") + _packed(topic) + _packed("msgpack")
    )
    body += len(pairs).to_bytes(4, "little") + pairs
    return RECORD.pack(CHANNEL, len(body)) + body


def _packed(text: str) -> bytes:
    data = text.encode()
    return len(data).to_bytes(4, "little") + data


def _text(body: bytes, at: int) -> tuple[str, int]:
    """Raises: ValueError when it does not end inside, or is no text."""
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    if at + 4 > len(body) or end > len(body):
        raise ValueError("a text without its end")
    return body[at + 4 : end].decode(), end


def _map(body: bytes, at: int) -> dict[str, str]:
    """Raises: ValueError when it does not fill its record."""
    if at + 4 + int.from_bytes(body[at : at + 4], "little") != len(body):
        raise ValueError("a map of another length than its record")
    at += 4
    out: dict[str, str] = {}
    while at < len(body):
        key, at = _text(body, at)
        out[key], at = _text(body, at)
    return out
