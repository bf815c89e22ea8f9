"""Frames of radio-control receivers, CRSF (Crossfire, ExpressLRS): channels and the quality of the link."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from swarmware.errors import WireError

BAUD: Final = 420_000
CHANNELS: Final = 16
_SYNC: Final = 0xC8
_CHANNELS_TYPE: Final = 0x16
_LINK_TYPE: Final = 0x14
_CHANNELS_BYTES: Final = 22
_LINK_BYTES: Final = 10
_LENGTH_MAX: Final = 62
_BITS: Final = 11
_CENTRE: Final = 992
_HALF: Final = 819.5
"""Ticks at 1500 µs, and from there to 988 or 2012 µs. Source: CRSF, frame type RC channels packed."""


class RcChannels(msgspec.Struct, frozen=True, gc=False):
    """Positions of all channels, -1 to 1."""

    positions: tuple[float, ...]


class RcLink(msgspec.Struct, frozen=True, gc=False):
    """Quality of the radio link to the receiver."""

    quality_ratio: float
    """Share of the frames that arrived, 0 to 1, or 0 if the transmitter is lost."""


def channels_frame(positions: Sequence[float]) -> bytes:
    """The frame of up to 16 channels; the others are in the centre."""
    packed = 0
    for i in range(CHANNELS):
        position = positions[i] if i < len(positions) else 0.0
        packed |= round(_CENTRE + min(max(position, -1.0), 1.0) * _HALF) << i * _BITS
    return _frame(_CHANNELS_TYPE, packed.to_bytes(_CHANNELS_BYTES, "little"))


def link_frame(quality_ratio: float) -> bytes:
    """The frame of the quality of the link, with zeros for unknown fields."""
    return _frame(_LINK_TYPE, bytes([0, 0, round(100 * quality_ratio)]) + bytes(_LINK_BYTES - 3))


def _frame(kind: int, payload: bytes) -> bytes:
    body = bytes([kind]) + payload
    return bytes([_SYNC, len(body) + 1]) + body + bytes([crc8(body)])


def crc8(data: bytes) -> int:
    """CRC-8 with the polynomial 0xD5 (DVB-S2)."""
    crc = 0
    for byte in data:
        crc = _TABLE[crc ^ byte]
    return crc


def _shifted(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1 ^ 0xD5 if byte & 0x80 else byte << 1) & 0xFF
    return byte


_TABLE: Final = tuple(_shifted(byte) for byte in range(256))


class CrsfDecoder:
    """Decodes the bytes of a receiver. `refused`: what was not understood, by the reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Valid frames so far, also of types that are not used."""
        self._open = bytearray()

    def feed(self, data: bytes) -> Iterator[RcChannels | RcLink]:
        """Channels and link states in the next bytes of the line."""
        self._open += data
        while True:
            start = self._open.find(_SYNC)
            if start != 0:
                skipped = len(self._open) if start < 0 else start
                if skipped:
                    self.refused["no frame"] += 1
                del self._open[:skipped]
            if len(self._open) < 2:
                return
            length = self._open[1]
            # the sync byte was data: search on behind it
            if not 2 <= length <= _LENGTH_MAX:
                self.refused["length out of range"] += 1
                del self._open[0]
                continue
            if len(self._open) < length + 2:
                return
            # A refused frame costs its first byte only: the sync byte may be data, and a valid frame may
            # follow in it.
            body, crc = bytes(self._open[2 : length + 1]), self._open[length + 1]
            if crc8(body) != crc:
                self.refused["CRC wrong"] += 1
                del self._open[0]
                continue
            del self._open[: length + 2]
            self.valid += 1
            try:
                found = _content(body)
            except WireError as error:
                self.refused[str(error)] += 1
                continue
            if found is not None:
                yield found


def _content(body: bytes) -> RcChannels | RcLink | None:
    """The content of a frame, or None for another type. Raises: WireError."""
    kind, payload = body[0], body[1:]
    if kind == _CHANNELS_TYPE:
        if len(payload) != _CHANNELS_BYTES:
            raise WireError(f"channels of {len(payload)} bytes, expected {_CHANNELS_BYTES}")
        # eleven bits a channel, the first one in the lowest bits
        packed = int.from_bytes(payload, "little")
        ticks = (packed >> i * _BITS & 0x7FF for i in range(CHANNELS))
        return RcChannels(tuple(min(max((tick - _CENTRE) / _HALF, -1.0), 1.0) for tick in ticks))
    if kind == _LINK_TYPE:
        if len(payload) < _LINK_BYTES:
            raise WireError(f"link of {len(payload)} bytes, expected {_LINK_BYTES}")
        # some receivers report more than 100 %
        return RcLink(min(payload[2], 100) / 100)
    return None
