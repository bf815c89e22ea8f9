"""Frames on a serial line: a body with its CRC, encoded by COBS so that a zero byte ends each frame."""

import binascii
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final

from swarmware.errors import WireError

CRC16_BYTES: Final = 2
CRC32_BYTES: Final = 4
_BLOCK: Final = 254
"""Bytes of the longest block of COBS."""

Check = Callable[[bytes], bytes]
"""Computes the check sum of a body."""


def crc16(body: bytes) -> bytes:
    """CRC-16/CCITT-FALSE of a body: for short frames."""
    return binascii.crc_hqx(body, 0xFFFF).to_bytes(CRC16_BYTES, "little")


def crc32(body: bytes) -> bytes:
    """CRC-32 (IEEE 802.3) of a body: one damaged frame in 2³² passes."""
    return zlib.crc32(body).to_bytes(CRC32_BYTES, "little")


def serial_frame(body: bytes, check: Check) -> bytes:
    """A body with its check sum, encoded by COBS, and the delimiter."""
    return cobs(body + check(body)) + b"\0"


def cobs(data: bytes) -> bytes:
    """Bytes without a zero. Source: Cheshire, Baker: Consistent Overhead Byte Stuffing."""
    out = bytearray()
    blocks = data.split(b"\0")
    for number, block in enumerate(blocks):
        rest = block
        # a full block has no zero behind it, which its code 0xFF states
        while len(rest) >= _BLOCK:
            out += b"\xff" + rest[:_BLOCK]
            rest = rest[_BLOCK:]
        # a full block at the end of the data needs no empty one
        if rest or not block or number < len(blocks) - 1:
            out += bytes([len(rest) + 1]) + rest
    return bytes(out)


def cobs_bytes(size: int) -> int:
    """Upper limit of the encoded size of a number of bytes."""
    return size + max(1, -(-size // _BLOCK))


def uncobs(data: bytes) -> bytes:
    """The inverse of `cobs`. Raises: WireError."""
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        block = data[at + 1 : at + code]
        if code == 0 or len(block) != code - 1:
            raise WireError("COBS: a block is cut short")
        out += block
        at += code
        # the zero that the block stands for; the last block has none
        if code < 0xFF and at < len(data):
            out.append(0)
    return bytes(out)


class FrameDecoder:
    """Finds the frames in the bytes of a line. `refused`: damaged ones, by the reason."""

    def __init__(self, limit: int, check: Check) -> None:
        """`limit`: bytes of the longest body with its check sum."""
        self.refused: Counter[str] = Counter()
        self._longest = cobs_bytes(limit)
        self._check = check
        self._check_bytes = len(check(b""))
        self._open = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The bodies of the valid frames in the next bytes."""
        *complete, rest = data.split(b"\0")
        for part in complete:
            self._collect(part)
            frame, overlong = bytes(self._open), self._overlong
            self._open.clear()
            self._overlong = False
            if overlong:
                self.refused["longer than a frame"] += 1
            elif frame:
                try:
                    yield self._body(frame)
                except WireError as error:
                    self.refused[str(error)] += 1
        self._collect(rest)

    def _collect(self, part: bytes) -> None:
        self._open += part
        # noise without a delimiter must not fill the memory
        if len(self._open) > self._longest:
            self._open.clear()
            self._overlong = True

    def _body(self, frame: bytes) -> bytes:
        plain = uncobs(frame)
        body = plain[: -self._check_bytes]
        if len(plain) <= self._check_bytes or plain[-self._check_bytes :] != self._check(body):
            raise WireError("CRC wrong")
        return body
