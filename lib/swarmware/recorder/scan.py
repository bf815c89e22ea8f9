"""Scanner for the complete records of an MCAP file, also of a growing, truncated or damaged one."""

import re
import struct
from collections.abc import Collection, Iterator
from typing import BinaryIO, Final, NamedTuple

from swarmware.model.frame import PAYLOAD_LIMIT

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD: Final = struct.Struct("<BQ")
MESSAGE: Final = struct.Struct("<HIQQ")
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE_OPCODE, METADATA, METADATA_INDEX, DATA_END = (
    0x01,
    0x02,
    0x03,
    0x04,
    0x05,
    0x0C,
    0x0D,
    0x0F,
)
RESERVED: Final = 0x80
"""Opcode of the room between the data and the end of a file that grows; 0x80 to 0xFF are for applications."""
FILLER: Final = 0x81
"""Opcode of an empty record, which moves the next one to another page."""
EMPTY_END: Final = RECORD.pack(DATA_END, 4) + bytes(4) + RECORD.pack(FOOTER, 20) + bytes(20) + MAGIC
"""A valid end without a summary."""
RESERVED_END: Final = b"SwarmLog" + EMPTY_END
"""End of the room, and of a file that grows: no writer has ended it."""
RECORD_LIMIT: Final = 2 * PAYLOAD_LIMIT
"""Maximum length of a record that a logger writes."""

LENGTHS: Final = {
    HEADER: (8, 4096),
    FOOTER: (20, 20),
    SCHEMA: (14, RECORD_LIMIT),
    CHANNEL: (16, 65_536),
    MESSAGE_OPCODE: (MESSAGE.size, RECORD_LIMIT),
    0x08: (56, RECORD_LIMIT),
    0x0A: (36, RECORD_LIMIT),
    0x0B: (42, RECORD_LIMIT),
    METADATA: (8, RECORD_LIMIT),
    METADATA_INDEX: (20, RECORD_LIMIT),
    0x0E: (17, 17),
    DATA_END: (4, 4),
    FILLER: (0, 0),
    RESERVED: (len(RESERVED_END) - len(EMPTY_END), 1 << 31),
}
"""Opcodes in our files, with minimum and maximum length. Source: MCAP specification."""
DATA: Final = frozenset({SCHEMA, CHANNEL, MESSAGE_OPCODE, METADATA, DATA_END, FOOTER, FILLER})
"""Opcodes between header and summary."""
_CHAIN: Final = 3
"""Consecutive plausible records that prove a record boundary."""
_CANDIDATE: Final = re.compile(rb"[\x01-\x0f\x80](?=.{4}\x00{4})", re.DOTALL)
_WINDOW: Final = 1 << 20


class Record(NamedTuple):
    """One complete record of the file."""

    start: int
    opcode: int
    body: bytes
    end: int


class Scan:
    """Iterates over the records from an offset on; skips damaged bytes and counts them.

    An incomplete record at the end is not consumed: the file may still grow.
    """

    def __init__(self, file: BinaryIO, size: int, at: int, opcodes: Collection[int] = DATA) -> None:
        self._opcodes = opcodes
        self.at = at
        """Offset behind the last record returned."""
        self.damaged_bytes = 0
        """Bytes skipped."""
        self.read_bytes = 0
        """Bytes read from the file."""
        self.room = False
        """Whether the scan ended at the room of a file that its writer has not ended."""
        self._file = file
        self._size = size
        self._base = 0
        self._data = b""
        self._header_at = -1
        """Offset of the last valid header: that behind a record is the first of the next one."""
        self._last_header = (0, 0)

    def __iter__(self) -> Iterator[Record]:
        while (record := self._next()) is not None:
            self.at = record.end
            yield record

    def _next(self) -> Record | None:
        start = self.at
        if self._is_room(start):
            self.room = True
            return None
        found = self._wanted(start)
        if found is not None and found[1] <= self._size:
            opcode, end = found
            # a valid record behind this one proves its length
            if self._header(end) is not None or end + RECORD.size > self._size:
                return Record(start, opcode, self._bytes(start + RECORD.size, end), end)
            # either this length is invalid, or the next record is damaged
            again = self._resume(start + 1)
            # this record is whole: the damage begins behind it
            if again is None or (again > end and self._header_half_valid(end, again)):
                return Record(start, opcode, self._bytes(start + RECORD.size, end), end)
        else:
            again = self._resume(start + 1)
        if again is None:
            return None
        self.damaged_bytes += again - start
        self.at = again
        return self._next()

    def _wanted(self, at: int) -> tuple[int, int] | None:
        """As `_header`, restricted to the opcodes of this part of the file; the header record comes first."""
        found = self._header(at)
        if found is None or found[0] in self._opcodes or (found[0] == HEADER and at == len(MAGIC)):
            return found
        return None

    def _is_room(self, at: int) -> bool:
        """Whether the preallocated end of a growing file begins at this offset, without records behind it."""
        found = self._header(at)
        if found is None or found[0] != RESERVED:
            return False
        mark = len(RESERVED_END) - len(EMPTY_END)
        return self._peek(found[1] - mark, len(RESERVED_END)) == RESERVED_END

    def _header_half_valid(self, at: int, again: int) -> bool:
        """Whether a damaged record begins at this offset: its opcode or its length is valid."""
        opcode, length = RECORD.unpack(self._peek(at, RECORD.size))
        return opcode in self._opcodes or at + RECORD.size + length == again

    def _header(self, at: int) -> tuple[int, int] | None:
        """Opcode and end of the record at this offset, or None if no record can begin there."""
        if at == self._header_at:
            return self._last_header
        head = self._peek(at, RECORD.size)
        if len(head) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(head)
        shortest, longest = LENGTHS.get(opcode, (1, 0))
        # random bytes rarely have a length that fits their opcode
        if not shortest <= length <= longest:
            return None
        self._header_at, self._last_header = at, (opcode, at + RECORD.size + length)
        return self._last_header

    def _resume(self, at: int) -> int | None:
        """Offset of the next run of consecutive plausible records, or of a record that ends the file."""
        while at < self._size:
            window = self._bytes(at, min(self._size, at + _WINDOW))
            for found in _CANDIDATE.finditer(window):
                if self._chain(at + found.start()):
                    return at + found.start()
            if at + len(window) >= self._size:
                return None
            # windows overlap by a header, which may cross their border
            at += len(window) - RECORD.size
        return None

    def _chain(self, at: int) -> bool:
        for count in range(_CHAIN):
            if self._is_room(at):
                return True
            found = self._header(at) if count else self._wanted(at)
            if found is None or found[1] > self._size:
                return False
            opcode, at = found
            if at == self._size or (opcode == FOOTER and self._peek(at, len(MAGIC)) == MAGIC):
                return True
        return True

    def _peek(self, at: int, length: int) -> bytes:
        """Reads a few bytes at any offset; the read window stays."""
        begin = at - self._base
        if begin >= 0 and begin + length <= len(self._data):
            return self._data[begin : begin + length]
        self._file.seek(at)
        self.read_bytes += length
        return self._file.read(length)

    def _bytes(self, start: int, end: int) -> bytes:
        """Reads a range of the file; shorter at its end."""
        if start < self._base or end > self._base + len(self._data):
            self._file.seek(start)
            self._base = start
            # whole windows: most records are short, and each read is a call of the kernel
            self._data = self._file.read(max(_WINDOW, end - start))
            self.read_bytes += len(self._data)
        return self._data[start - self._base : end - self._base]


def has_end(file: BinaryIO, size: int) -> int | None:
    """Offset of the summary of a finished file, 0 when it has none, or None for an unfinished file."""
    tail = RECORD.size + 20 + len(MAGIC)
    if size < len(MAGIC) + len(RESERVED_END):
        return None
    file.seek(size - len(RESERVED_END))
    data = file.read(len(RESERVED_END))
    # the end of the reserved room, not the end of the log
    if data == RESERVED_END:
        return None
    data = data[-tail:]
    if len(data) < tail or data[-len(MAGIC) :] != MAGIC or RECORD.unpack_from(data) != (FOOTER, 20):
        return None
    start = int.from_bytes(data[RECORD.size : RECORD.size + 8], "little")
    # An offset behind the end is damage: the records are read without a summary.
    return start if start <= size - tail else 0
