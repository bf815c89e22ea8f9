"""Compression of payloads: methods as text, and a container that states version, filter, method and size."""

import struct
import zlib
from enum import StrEnum
from typing import Final, Self

import msgspec

from swarmware.errors import InvalidInput, WireError
from swarmware.model import record_filter
from swarmware.model.frame import PAYLOAD_LIMIT
from swarmware.model.record_filter import NO_RECORDS, Layout, Records

VERSION: Final = 1
"""Version of the container; another one is refused."""
_HEADER: Final = struct.Struct("<BBBBIIH")
"""Version, method, layout, items, bytes of the payload, bytes of the records, bytes of one record."""
CONTAINER: Final = 8
"""Codec of an item of a notification whose data are a container."""
_COUNT_AT: Final = 3
COUNT_MAX: Final = 64
"""Most items of a notification."""


class Method(StrEnum):
    """Compression method of values."""

    NONE = "none"
    ZLIB = "zlib"
    ZSTD = "zstd"
    JPEG = "jpeg"
    """Images alone, with loss; the level is the quality."""
    H264 = "h264"
    """Streams of images as video, over RTP."""
    AUTO = "auto"
    """The method with the least processor time for its reduction."""


_LEVELS: Final = {Method.ZLIB: (1, 9, 6), Method.ZSTD: (1, 19, 3), Method.JPEG: (1, 95, 80)}
"""Lowest, highest and default level. Above 95 a JPEG grows without becoming better (Pillow's manual)."""
_NUMBERS: Final = {Method.ZLIB: 1, Method.ZSTD: 2}
"""Methods of the container."""
READABLE: Final = ("zlib", "zstd", "records", "vlp16")
"""Methods and layouts of version 1 that this version reads, as a subscriber states them."""
_LAYOUT_NAMES: Final = {Layout.RECORDS: "records", Layout.VLP16: "vlp16"}


class Compression(msgspec.Struct, frozen=True):
    """A method with its level."""

    method: Method = Method.NONE
    level: int = 0
    """0: the method has none."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """A method, or method and level: `zstd`, `zlib:6`, `jpeg:80`. Raises: InvalidInput."""
        name, colon, level = text.partition(":")
        try:
            method = Method(name)
        except ValueError:
            known = ", ".join(Method)
            raise InvalidInput(f"compression {name!r}: expected one of {known}") from None
        lowest, highest, usual = _LEVELS.get(method, (0, 0, 0))
        if not colon:
            return cls(method, usual)
        if not (level.isascii() and level.isdigit() and highest and lowest <= int(level) <= highest):
            expected = f"{method}:{lowest} to {method}:{highest}" if highest else f"{method} without a level"
            raise InvalidInput(f"compression {text!r}: expected {expected}")
        return cls(method, int(level))

    def __str__(self) -> str:
        return f"{self.method}:{self.level}" if self.level else str(self.method)


AUTO: Final = Compression(Method.ZSTD, 1)
"""Compression of a channel that is set to `auto` (`tests/bench/compression.py`)."""


def needs(compression: Compression, records: Records = NO_RECORDS) -> frozenset[str]:
    """Capabilities that a receiver needs: the method, and the layout of the records."""
    layout = _LAYOUT_NAMES.get(records.layout)
    return frozenset((str(compression.method), *(() if layout is None else (layout,))))


def pack(payload: bytes, compression: Compression, records: Records = NO_RECORDS, items: int = 1) -> bytes:
    """A payload in a container, compressed by zlib or zstd after the filter of its records.

    `items`: values in the payload, for those who count them without reading it.
    """
    plain = record_filter.apply(payload, records)
    if compression.method is Method.ZLIB:
        body = zlib.compress(plain, compression.level)
    else:
        body = _zstd(plain, compression.level)
    number = _NUMBERS[compression.method]
    header = _HEADER.pack(
        VERSION,
        number,
        records.layout,
        min(items, COUNT_MAX),
        len(payload),
        records.size,
        records.record_bytes,
    )
    return header + body


def items_in(data: bytes) -> int:
    """Number of values in a container, which may be damaged; 1 where it does not state it."""
    return min(COUNT_MAX, max(1, data[_COUNT_AT])) if len(data) >= _HEADER.size else 1


def unpack(data: bytes | memoryview) -> bytes:
    """The payload of a container.

    Raises: WireError for another version, an unknown method or layout, and a payload of another size than the
    header states.
    """
    if len(data) < _HEADER.size:
        raise WireError(f"container of {len(data)} bytes: expected at least {_HEADER.size}")
    version, number, layout, _, size, records_size, record_bytes = _HEADER.unpack_from(data)
    if version != VERSION:
        raise WireError(f"container of version {version}: expected {VERSION}")
    # Checked before the decompression: a few bytes can state any size.
    if size > PAYLOAD_LIMIT:
        raise WireError(f"container states {size} bytes: expected at most {PAYLOAD_LIMIT}")
    body = memoryview(data)[_HEADER.size :]
    if number == _NUMBERS[Method.ZLIB]:
        plain = inflate(body, size)
    elif number == _NUMBERS[Method.ZSTD]:
        plain = unzstd(body, size)
    else:
        raise WireError(f"container with method {number}: expected {sorted(_NUMBERS.values())}")
    if len(plain) != size:
        raise WireError(f"container has {len(plain)} bytes: it states {size}")
    try:
        records = Records(Layout(layout), record_bytes, records_size)
    except ValueError:
        raise WireError(f"container with layout {layout}: expected {[int(one) for one in Layout]}") from None
    return record_filter.revert(plain, records)


def inflate(data: bytes | memoryview, limit: int) -> bytes:
    """Data of zlib, of at most `limit` bytes. Raises: WireError when it is damaged or longer."""
    decompressor = zlib.decompressobj()
    try:
        # one more than the limit: the end of the stream comes after the last byte
        out = decompressor.decompress(data, limit + 1)
    except zlib.error as error:
        raise WireError(f"zlib payload: {error}") from error
    if not decompressor.eof or len(out) > limit:
        raise WireError(f"zlib payload: cut short, or more than {limit} bytes")
    return out


def unzstd(data: bytes | memoryview, limit: int) -> bytes:
    """Data of zstd, of at most `limit` bytes. Raises: WireError when it is damaged or longer."""
    import zstandard  # most commands decode no such payload, and start sooner

    try:
        # zstd allocates the stated size before it checks the data
        stated = zstandard.frame_content_size(data)
        if stated <= limit:
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
    except (zstandard.ZstdError, ValueError) as error:
        raise WireError(f"zstd payload: {error}") from error
    raise WireError(f"zstd payload: states {stated} bytes, expected at most {limit}")


def _zstd(data: bytes, level: int) -> bytes:
    import zstandard

    # made for each call: two threads must not use one at once
    return zstandard.ZstdCompressor(level=level).compress(data)
