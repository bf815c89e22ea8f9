"""One MCAP file of the local ring: writer and reader, which tolerates a growing or damaged file."""

import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.growing_file import GrowingFile
from swarmware.recorder.mcap_writer import McapWriter, channel_record
from swarmware.recorder.payload_type import schema
from swarmware.recorder.scan import (
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
from swarmware.version import __version__

_I64: Final = 1 << 63
_U64: Final = 1 << 64
BUFFER_LIMIT: Final = 32 << 20
"""Size limit of the write buffer of a failing disk; entries beyond it are dropped and counted."""

COUNTERS: Final = "swarm.queues"
"""Name of the metadata record at the start of each segment: last sequence number of every queue."""
STAMPS: Final = "swarm.stamps"
"""As `COUNTERS`, for the newest stamp of every path."""
CLOCK: Final = "swarm.clock"
"""Name of a metadata record: UTC minus the clock of the platform, for the stamps of the entries behind it."""
_OFFSET: Final = "utc_minus_clock_ns"
_STEP_NS: Final = 1_000_000
"""Change of that offset that is recorded; MCAP readers show the stamps in UTC with this accuracy."""
FINAL: Final = "swarm.end."
"""Prefix of both at the end of a finished segment: a start reads only this end."""
CHECK: Final = "check"
"""Key of the checksum in channel and metadata records: many entries depend on one of them."""
_SMALLEST: Final = RECORD.size + MESSAGE.size


class LogChannel(msgspec.Struct, frozen=True, gc=False):
    """Common properties of all entries of one resource: an MCAP channel."""

    platform: str
    path: str
    kind: str
    type: str
    queue: str
    sender: str = ""
    """Sender of a command, or "" for another entry."""
    description: str = ""
    """As `LogEntry.description`; valid, and not longer than `DESCRIPTION_LIMIT`."""


class BufferFull(OSError):
    """The write buffer is full because the disk has not accepted data for too long."""


class SegmentWriter:
    """Appends entries to one MCAP file.

    The file is not chunked: a truncation at any byte loses no record before it.
    """

    def __init__(
        self,
        path: Path,
        counters: Mapping[str, int],
        stamps: Mapping[str, int] | None = None,
        *,
        reserved_bytes: int = 1 << 20,
    ) -> None:
        """Create the file. `reserved_bytes`: expected size of the segment; it may become larger.

        Raises: InvalidInput when it exists; OSError of the file system.
        """
        self.path = path
        self._out = GrowingFile(path, reserved_bytes)
        self._writer = McapWriter(self._out, f"swarmware {__version__}")
        self._add_numbers(COUNTERS, counters)
        self._add_numbers(STAMPS, stamps or {})
        try:
            self._out.flush()
        # Also for an interrupt: `close` removes the unfinished file.
        except BaseException:
            self._out.close()
            raise
        self._channels: dict[LogChannel, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._offset_ns: int | None = None
        self._offset_copy = False
        """Whether the record of the offset has to be repeated behind the next entry."""
        self._closed = False
        self.bytes = 0
        """Bytes of payload and record headers so far."""

    def _add_numbers(self, name: str, numbers: Mapping[str, int]) -> None:
        data = {key: str(number) for key, number in numbers.items()}
        self._writer.add_metadata(name, data | {CHECK: _check(data, name)})

    def append(self, channel: LogChannel, sequence: int, stamp_ns: int, utc_ns: int, payload: bytes) -> None:
        """Appends one entry; `flush` writes it to the file.

        Raises: BufferFull when the write buffer is full.
        """
        # before a sequence number is used: a refused entry must not leave a gap
        if self._out.pending_bytes > BUFFER_LIMIT:
            raise BufferFull(f"{self.path}: write buffer full, {self._out.pending_bytes} bytes")
        number = self._channels.get(channel)
        copy = b""
        if number is None:
            number, copy = self._register(channel)
        # viewers of MCAP show this stamp as UTC; readers of this project subtract the offset again
        sent_ns = stamp_ns + (self._offset_ns or 0)
        self._writer.add_message(number, sequence, utc_ns, sent_ns % _U64, payload)
        # behind the entry: damage rarely covers both places
        self._out.write(copy)
        if self._offset_copy:
            self._offset_copy = False
            self._add_numbers(CLOCK, {_OFFSET: self._offset_ns or 0})
        self.bytes += len(payload) + _SMALLEST

    def set_clock(self, utc_minus_clock_ns: int) -> None:
        """Sets the offset with which the stamps of the next entries are written as UTC."""
        if self._offset_ns is None or abs(utc_minus_clock_ns - self._offset_ns) >= _STEP_NS:
            self._offset_ns = utc_minus_clock_ns
            self._add_numbers(CLOCK, {_OFFSET: utc_minus_clock_ns})
            # without it damage to the first would change the stamps of all entries behind it
            self._offset_copy = True

    def _register(self, channel: LogChannel) -> tuple[int, bytes]:
        """Channel id, and a copy of the record: without it damage to the first would lose the channel."""
        # modules may describe one type name in different ways
        described = channel.type, channel.description
        schema_id = self._schemas.get(described)
        if schema_id is None:
            data = schema(*described)
            schema_id = self._writer.register_schema(channel.type, data) if data else 0
            self._schemas[described] = schema_id
        topic = f"/{channel.platform}/{channel.path}"
        metadata = {
            "kind": channel.kind,
            "type": channel.type,
            "queue": channel.queue,
            "clock": channel.platform,
        }
        if channel.sender:
            metadata["sender"] = channel.sender
        if channel.description:
            metadata["description"] = channel.description
        metadata[CHECK] = _check(metadata, topic)
        number = self._writer.register_channel(schema_id, topic, metadata)
        self._channels[channel] = number
        return number, channel_record(number, schema_id, topic, metadata)

    @property
    def pending_bytes(self) -> int:
        """Size of the write buffer, in bytes."""
        return self._out.pending_bytes

    @property
    def written_bytes(self) -> int:
        """Size of the data in the file, in bytes; the room behind it is sparse."""
        return self._out.tell() - self._out.pending_bytes

    def flush(self) -> int:
        """Writes the buffer; the size of the file."""
        if self._closed:
            self._out.finish()
        else:
            self._out.flush()
        return self._out.tell()

    def sync(self) -> None:
        """Waits until the flushed data survives a power failure."""
        self._out.sync()

    def finish(self, counters: Mapping[str, int], stamps: Mapping[str, int]) -> None:
        """Writes the final sequence numbers and stamps, and the summary that MCAP tools use as index."""
        if not self._closed:
            self._closed = True
            self._add_numbers(FINAL + COUNTERS, counters)
            self._add_numbers(FINAL + STAMPS, stamps)
            self._writer.finish()

    def close(self) -> None:
        """Writes the buffer and closes the file. Raises: OSError when the write fails."""
        try:
            if not self._closed:
                self._closed = True
                self._writer.finish()
            self._out.finish()
        finally:
            self._out.close()


class SegmentReader:
    """Reads the entries of one segment from its start, also while it is being written.

    `offset` is the end of the last complete record read: the next call continues there. Damaged bytes are
    skipped and counted.
    """

    def __init__(self, path: Path, offset: int = 0) -> None:
        self.path = path
        self.offset = len(MAGIC)
        self.counters: dict[str, int] = {}
        """Sequence number of each queue at the start of the segment; after `final` at its end."""
        self.stamps: dict[str, int] = {}
        """Newest stamp of each path, at the same instant as `counters`."""
        self.sound = False
        """Whether `counters` could be read."""
        self.ended = False
        """Whether the end record of the data has been read."""
        self.growing = False
        """True if the segment is preallocated and was not closed."""
        self.damaged = 0
        """Number of damaged places."""
        self.damaged_bytes = 0
        self.lost_end_bytes = 0
        """Bytes at the end of the file, at the last read, that are neither records nor the room of a writer.
        They do not count as damaged: a copy of the file may still grow."""
        self.read_bytes = 0
        """Bytes read from the file so far."""
        self._offset_ns: int | None = None
        """UTC minus the platform's clock, or None if stamps are not in UTC."""
        self._channels: dict[int, LogChannel] = {}
        self._sequences: dict[str, int] = {}
        self._room: dict[str, int] = {}
        """`damaged_bytes` at the last entry of each queue: bounds the number of entries missing after it."""
        self._summary_read = False
        self._resume = offset
        """Entries before this offset are skipped; channels are read."""

    def entries(self) -> Iterator[LogEntry]:
        """Complete entries that are in the file now."""
        with self.path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if self.offset == len(MAGIC) and not self.damaged and file.read(len(MAGIC)) != MAGIC[:size]:
                self._count(len(MAGIC))
            self.lost_end_bytes = 0
            scan = Scan(file, size, self.offset)
            passed = 0
            for record in scan:
                if scan.damaged_bytes > passed:
                    self._count(scan.damaged_bytes - passed)
                    passed = scan.damaged_bytes
                self.read_bytes, scan.read_bytes = self.read_bytes + scan.read_bytes, 0
                # what follows is the summary, which repeats the channels
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
            if scan.damaged_bytes > passed:
                self._count(scan.damaged_bytes - passed)
                self.offset = scan.at
            self.growing = scan.room
            self.lost_end_bytes = 0 if scan.room else size - scan.at
            self.read_bytes += scan.read_bytes

    def _count(self, length: int) -> None:
        self.damaged += 1
        self.damaged_bytes += length

    def _entry(self, record: Record, file: BinaryIO, size: int) -> LogEntry | None:
        number, sequence, utc_ns, sent_ns = MESSAGE.unpack_from(record.body)
        channel = self._channels.get(number)
        # both records of the channel are damaged: a finished file has a third one at its end
        if channel is None and not self._summary_read:
            self._summary_read = True
            self._channels = _summary_channels(file, size) | self._channels
            channel = self._channels.get(number)
        # an instant beyond 2262 is damage, and would break the order of the entries
        if channel is None or utc_ns >= _I64:
            self._count(record.end - record.start)
            return None
        sent_ns = _signed(sent_ns)
        known = self._offset_ns is not None
        return LogEntry(
            channel.queue,
            self._sequence(channel.queue, sequence, record),
            channel.platform,
            channel.path,
            channel.kind,
            channel.type,
            _signed(sent_ns - (self._offset_ns or 0)),
            utc_ns,
            record.body[MESSAGE.size :],
            channel.sender,
            sent_ns if known else 0,
            channel.description,
        )

    def _sequence(self, queue: str, sequence: int, record: Record) -> int:
        """The entry's sequence number; a damaged one is corrected: only damage makes gaps in a queue."""
        last = self._sequences.get(queue)
        if last is None and self.sound:
            last = self.counters.get(queue, 0)
        if last is not None:
            # the damaged bytes bound the number of missing entries
            room = (self.damaged_bytes - self._room.get(queue, 0)) // _SMALLEST
            if not last < sequence <= last + 1 + room:
                self._count(record.end - record.start)
                return last + 1  # the next entry shows whether this sequence number was damaged
        self._sequences[queue] = sequence
        self._room[queue] = self.damaged_bytes
        return sequence

    def _add_channel(self, body: bytes) -> None:
        found = _channel(body)
        if found is None:
            self._count(RECORD.size + len(body))
        else:
            # the first record counts; the copy is only for the case that it is damaged
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
        elif name == CLOCK:
            self._offset_ns = numbers.get(_OFFSET)

    def final(self) -> bool:
        """Reads the counters at the end of a finished segment; False when there are none."""
        with self.path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            places = _summary(file, size, METADATA_INDEX)
            found: dict[str, dict[str, int]] = {}
            for body in places:
                offset, length = int.from_bytes(body[:8], "little"), int.from_bytes(body[8:16], "little")
                # offsets in a damaged index may lie anywhere
                if length > size or offset > size or FINAL.encode() not in body[16:]:
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


def _signed(number: int) -> int:
    """The integer of 64 bits with sign that has the same bits."""
    return (number + _I64) % _U64 - _I64


def ended(path: Path) -> bool:
    """Whether the segment was finished, by its writer or by a repair."""
    with path.open("rb") as file:
        return has_end(file, os.fstat(file.fileno()).st_size) is not None


def _summary(file: BinaryIO, size: int, opcode: int) -> list[bytes]:
    """Bodies of the records with one opcode in the summary of a finished file."""
    start = has_end(file, size)
    if not start:
        return []
    return [record.body for record in Scan(file, size, start, LENGTHS) if record.opcode == opcode]


def _summary_channels(file: BinaryIO, size: int) -> dict[int, LogChannel]:
    found = map(_channel, _summary(file, size, CHANNEL))
    return dict(one for one in found if one is not None)


def _channel(body: bytes) -> tuple[int, LogChannel] | None:
    """Channel id and channel, or None if the record is damaged."""
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
    sender, description = metadata.get("sender", ""), metadata.get("description", "")
    return number, LogChannel(platform, path, kind, type_name, queue, sender, description)


def _numbers(body: bytes) -> tuple[str, dict[str, int]] | None:
    """Name and content of a metadata record, or None if it is damaged."""
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


def _text(body: bytes, at: int) -> tuple[str, int]:
    """Reads a string; its end. Raises: InvalidInput when it exceeds the record, or is not UTF-8."""
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    if at + 4 > len(body) or end > len(body):
        raise InvalidInput("string exceeds its record")
    return body[at + 4 : end].decode(), end


def _map(body: bytes, at: int) -> dict[str, str]:
    """Reads a map of strings. Raises: InvalidInput when its length does not match the record."""
    if at + 4 + int.from_bytes(body[at : at + 4], "little") != len(body):
        raise InvalidInput("length of the map differs from its record")
    at += 4
    out: dict[str, str] = {}
    while at < len(body):
        key, at = _text(body, at)
        out[key], at = _text(body, at)
    return out
