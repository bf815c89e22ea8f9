"""Datagrams on a serial line: a number before each, so that the receiver counts those that did not arrive."""

from collections import Counter
from collections.abc import Iterator
from typing import Final

from swarmware.devices.serial_frames import CRC32_BYTES, FrameDecoder, cobs_bytes, crc32, serial_frame

BITS: Final = 10
"""Bits of a byte on the line: start, eight data bits, stop."""
NUMBER_BYTES: Final = 2
DATAGRAM_MAX: Final = 1238
"""Longest beacon, and longest datagram with a frame or a packet."""
BODY_MAX: Final = NUMBER_BYTES + DATAGRAM_MAX + CRC32_BYTES


def line_bytes(datagram_bytes: float) -> int:
    """Bytes on the line of a datagram."""
    return cobs_bytes(round(datagram_bytes) + NUMBER_BYTES + CRC32_BYTES) + 1


class LineSender:
    """Numbers the datagrams of a line."""

    def __init__(self) -> None:
        self._number = -1

    def frame(self, datagram: bytes) -> bytes:
        """The next frame on the line."""
        self._number = (self._number + 1) & 0xFFFF
        return serial_frame(self._number.to_bytes(NUMBER_BYTES, "little") + datagram, crc32)


class LineReceiver:
    """Finds the datagrams in the bytes of a line."""

    def __init__(self) -> None:
        self._decoder = FrameDecoder(BODY_MAX, crc32)

    @property
    def refused(self) -> Counter[str]:
        """Bytes outside of valid frames, by the reason."""
        return self._decoder.refused

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Number and content of each datagram in the next bytes."""
        for body in self._decoder.feed(data):
            if len(body) <= NUMBER_BYTES:
                self.refused["no datagram"] += 1
                continue
            yield int.from_bytes(body[:NUMBER_BYTES], "little"), body[NUMBER_BYTES:]
