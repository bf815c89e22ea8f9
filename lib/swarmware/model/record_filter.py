"""Reversible filters before a compression: equal records as columns, in which neighbours differ little."""

from enum import IntEnum
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.lanes import BYTE, WORD, differences, sums, unzigzag, zigzag

VLP16_PACKET: Final = 1206
"""Bytes of a data packet of a Velodyne VLP-16: 12 blocks of 100, time stamp, two factory bytes (VLP-16 User
Manual, 63-9243, section 9.3)."""
_BLOCK: Final = 100
_BLOCKS: Final = 12
_BLOCK_BYTES: Final = _BLOCK * _BLOCKS
_LASERS: Final = 16
_POINT: Final = 3
"""Bytes of a point: distance as a little-endian word, reflectivity."""
_POINTS_AT: Final = 4
"""After flag and azimuth of the block."""
_SECOND_AT: Final = _POINTS_AT + _LASERS * _POINT
"""A block has two firings of all lasers."""


class Layout(IntEnum):
    """Layout of the records, a number on the wire."""

    BYTES = 0
    """No records: the bytes stay as they are."""
    RECORDS = 1
    """Records of equal length, such as points with padding: one column for each byte."""
    VLP16 = 2
    """Records that end with a data packet of a Velodyne VLP-16: columns of azimuths, and of distances and
    reflectivities by laser."""


class Records(msgspec.Struct, frozen=True):
    """Records at the end of a payload."""

    layout: Layout = Layout.BYTES
    record_bytes: int = 0
    size: int = 0
    """Bytes of all records."""


NO_RECORDS: Final = Records()
_FLAG: Final = b"\xff\xee"
"""Begin of each block of a VLP-16."""


def vlp16_records(data: bytes) -> Records:
    """The bytes as packets of a VLP-16; none when they are something else."""
    # packets only: a single odd byte would shift all columns
    if not data or len(data) % VLP16_PACKET or not data.startswith(_FLAG):
        return NO_RECORDS
    return Records(Layout.VLP16, VLP16_PACKET, len(data))


def apply(data: bytes, records: Records) -> bytes:
    """The bytes with their records as columns of differences; as many bytes as before."""
    if records.layout is Layout.BYTES:
        return data
    start, end = _span(len(data), records)
    columns = _vlp16_columns if records.layout is Layout.VLP16 else _record_columns
    return b"".join((data[:start], columns(data[start:end], records.record_bytes), data[end:]))


def revert(data: bytes, records: Records) -> bytes:
    """Inverse of `apply`. Raises: WireError when the data cannot have such records."""
    if records.layout is Layout.BYTES:
        return data
    # the numbers come with the data from another platform
    if records.record_bytes < 1 or records.size > len(data):
        raise WireError(
            f"records of {records.record_bytes} bytes, {records.size} in all, in a payload of {len(data)}"
        )
    if records.layout is Layout.VLP16 and records.record_bytes < VLP16_PACKET:
        raise WireError(f"packets of {records.record_bytes} bytes; expected {VLP16_PACKET} of a VLP-16")
    start, end = _span(len(data), records)
    packets = _vlp16_packets if records.layout is Layout.VLP16 else _records
    return b"".join((data[:start], packets(data[start:end], records.record_bytes), data[end:]))


def _span(size: int, records: Records) -> tuple[int, int]:
    """Begin and end of the whole records."""
    start = size - records.size
    return start, start + records.size // records.record_bytes * records.record_bytes


def _record_columns(data: bytes, record_bytes: int) -> bytes:
    # without differences: columns of floats do not gain by them
    return b"".join(data[at::record_bytes] for at in range(record_bytes))


def _records(data: bytes, record_bytes: int) -> bytes:
    count = len(data) // record_bytes
    out = bytearray(len(data))
    for at in range(record_bytes):
        out[at::record_bytes] = data[at * count : (at + 1) * count]
    return bytes(out)


def _vlp16_columns(data: bytes, record_bytes: int) -> bytes:
    head, rest = record_bytes - VLP16_PACKET, record_bytes - _BLOCK_BYTES
    starts = range(0, len(data), record_bytes)
    blocks = b"".join(data[at + head : at + head + _BLOCK_BYTES] for at in starts)
    rests = b"".join(
        data[at : at + head] + data[at + head + _BLOCK_BYTES : at + record_bytes] for at in starts
    )
    rows = len(blocks) // _BLOCK
    azimuths = bytearray(WORD * rows)
    azimuths[::WORD], azimuths[1::WORD] = blocks[2::_BLOCK], blocks[3::_BLOCK]
    distances, reflectivities = bytearray(4 * rows * _LASERS), bytearray(2 * rows * _LASERS)
    for laser in range(_LASERS):
        # the two firings of a block follow each other: neighbours in a column are neighbours in time
        end = laser + 1
        for firing, at in enumerate((_POINTS_AT + laser * _POINT, _SECOND_AT + laser * _POINT)):
            first = 4 * rows * laser + WORD * firing
            distances[first : 4 * rows * end : 4] = blocks[at::_BLOCK]
            distances[first + 1 : 4 * rows * end : 4] = blocks[at + 1 :: _BLOCK]
            reflectivities[2 * rows * laser + firing : 2 * rows * end : 2] = blocks[at + 2 :: _BLOCK]
    # distances rise and fall: zigzag turns small negative steps into small numbers
    steps = zigzag(differences(distances, WORD), WORD)
    # azimuths only rise, so their steps are small without a sign
    turns = differences(azimuths, WORD)
    return b"".join(
        (
            blocks[::_BLOCK],
            blocks[1::_BLOCK],
            turns[::WORD],
            turns[1::WORD],
            steps[::WORD],
            steps[1::WORD],
            zigzag(differences(reflectivities, BYTE), BYTE),
            *(rests[at::rest] for at in range(rest)),
        )
    )


def _vlp16_packets(data: bytes, record_bytes: int) -> bytes:
    head, rest = record_bytes - VLP16_PACKET, record_bytes - _BLOCK_BYTES
    count = len(data) // record_bytes
    rows = count * _BLOCKS
    parts = _Parts(data)
    blocks = bytearray(rows * _BLOCK)
    blocks[::_BLOCK], blocks[1::_BLOCK] = parts.take(rows), parts.take(rows)
    azimuths = sums(parts.words(rows), WORD)
    blocks[2::_BLOCK], blocks[3::_BLOCK] = azimuths[::WORD], azimuths[1::WORD]
    distances = sums(unzigzag(parts.words(2 * rows * _LASERS), WORD), WORD)
    reflectivities = sums(unzigzag(parts.take(2 * rows * _LASERS), BYTE), BYTE)
    for laser in range(_LASERS):
        end = laser + 1
        for firing, at in enumerate((_POINTS_AT + laser * _POINT, _SECOND_AT + laser * _POINT)):
            first = 4 * rows * laser + WORD * firing
            blocks[at::_BLOCK] = distances[first : 4 * rows * end : 4]
            blocks[at + 1 :: _BLOCK] = distances[first + 1 : 4 * rows * end : 4]
            blocks[at + 2 :: _BLOCK] = reflectivities[2 * rows * laser + firing : 2 * rows * end : 2]
    rests = bytearray(count * rest)
    for at in range(rest):
        rests[at::rest] = parts.take(count)
    return b"".join(
        part
        for index in range(count)
        for part in (
            rests[index * rest : index * rest + head],
            blocks[index * _BLOCK_BYTES : (index + 1) * _BLOCK_BYTES],
            rests[index * rest + head : (index + 1) * rest],
        )
    )


class _Parts:
    """Bytes that are taken part by part."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, size: int) -> bytes:
        self._at += size
        return self._data[self._at - size : self._at]

    def words(self, count: int) -> bytearray:
        """Words of which all low bytes come first, then all high ones."""
        out = bytearray(WORD * count)
        out[::WORD], out[1::WORD] = self.take(count), self.take(count)
        return out
