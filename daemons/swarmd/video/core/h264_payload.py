"""H.264 in RTP (RFC 6184, packetization mode 1): single NAL units, aggregates (STAP-A), fragments (FU-A)."""

import re
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.errors import WireError

IDR: Final = 5
"""Type of a NAL unit with a slice of a key picture, at which decoding can begin."""
STAP_A: Final = 24
FU_A: Final = 28
_SINGLE: Final = range(1, 24)
_TYPE: Final = 0x1F
_REFERENCE: Final = 0x60
"""Mask of `nal_ref_idc`, the importance of a NAL unit for other ones."""
_FORBIDDEN: Final = 0x80
_START: Final = 0x80
_END: Final = 0x40
_START_CODE: Final = re.compile(b"\x00\x00\x01")
ANNEX_B: Final = b"\x00\x00\x00\x01"
UNIT_MAX: Final = 4 * 1024 * 1024
"""Maximum size of a picture that is reassembled."""


def nal_units(stream: bytes) -> list[bytes]:
    """Splits a byte stream (H.264, annex B) into NAL units."""
    starts = [found.span() for found in _START_CODE.finditer(stream)]
    if not starts:
        return []
    ends = [begin for begin, _ in starts[1:]] + [len(stream)]
    # zeros before a start code belong to it, because a NAL unit never ends with a zero
    units = (stream[start:end].rstrip(b"\x00") for (_, start), end in zip(starts, ends, strict=True))
    return [unit for unit in units if unit]


def unit_type(unit: bytes) -> int:
    """Type of a NAL unit (H.264, table 7-1)."""
    return unit[0] & _TYPE


def packetize(units: Iterable[bytes], payload_max: int) -> list[bytes]:
    """Payloads of RTP packets for the NAL units of one picture, each up to `payload_max` bytes."""
    payloads: list[bytes] = []
    small: list[bytes] = []
    room = payload_max - 1
    for unit in units:
        if len(unit) + 2 > room:
            payloads += _aggregated(small)
            small, room = [], payload_max - 1
        if len(unit) > payload_max:
            payloads += _fragments(unit, payload_max)
        elif len(unit) + 2 > room:
            payloads.append(unit)
        else:
            small.append(unit)
            room -= len(unit) + 2
    return payloads + _aggregated(small)


def _aggregated(units: list[bytes]) -> list[bytes]:
    if len(units) < 2:
        return units
    # the most important unit decides (RFC 6184, section 5.7.1)
    indicator = STAP_A | max(unit[0] & _REFERENCE for unit in units)
    return [bytes((indicator,)) + b"".join(len(unit).to_bytes(2) + unit for unit in units)]


def _fragments(unit: bytes, payload_max: int) -> list[bytes]:
    indicator, kind = unit[0] & _REFERENCE | FU_A, unit[0] & _TYPE
    step = payload_max - 2
    out = []
    for at in range(1, len(unit), step):
        header = kind | (_START if at == 1 else 0) | (_END if at + step >= len(unit) else 0)
        out.append(bytes((indicator, header)) + unit[at : at + step])
    return out


class AccessUnit(msgspec.Struct, frozen=True):
    """All NAL units of one picture."""

    timestamp: int
    """Instant of the picture in units of 1/90 000 s, modulo 2³²."""
    units: tuple[bytes, ...]

    @property
    def is_key(self) -> bool:
        """True if decoding can begin at this picture."""
        return any(unit_type(unit) == IDR for unit in self.units)

    @property
    def stream(self) -> bytes:
        """The picture as a byte stream (H.264, annex B)."""
        return b"".join(ANNEX_B + unit for unit in self.units)


class Depacketizer:
    """Reassembles pictures from payloads in order; a picture with a gap is dropped."""

    def __init__(self) -> None:
        self.damaged = 0
        """Number of pictures dropped because of a gap."""
        self._units: list[bytes] = []
        self._fragment: bytearray | None = None
        self._timestamp: int | None = None
        self._is_damaged = False
        self._bytes = 0

    def on_gap(self) -> None:
        """Takes that packets before the next payload are lost."""
        self._is_damaged = True
        self._fragment = None

    def on_payload(self, payload: bytes, timestamp: int, marker: bool) -> list[AccessUnit]:
        """Takes a payload; returns the pictures that it completes.

        Raises: WireError if the payload is damaged or of another mode; its picture is dropped.
        """
        done: list[AccessUnit] = []
        if self._timestamp is not None and timestamp != self._timestamp:
            done = self._finish()  # the packet with the marker is lost, or the sender sets no marker
        self._timestamp = timestamp
        try:
            self._take(payload)
        except WireError:
            self.on_gap()
            raise
        finally:
            if marker:
                done += self._finish()
        return done

    def _finish(self) -> list[AccessUnit]:
        units, timestamp = tuple(self._units), self._timestamp or 0
        is_damaged = self._is_damaged or self._fragment is not None
        self._units, self._fragment, self._timestamp = [], None, None
        self._is_damaged, self._bytes = False, 0
        self.damaged += is_damaged
        return [AccessUnit(timestamp, units)] if units and not is_damaged else []

    def _take(self, payload: bytes) -> None:
        if not payload or payload[0] & _FORBIDDEN:
            raise WireError(f"H.264 payload of {len(payload)} bytes: expected a NAL unit")
        self._bytes += len(payload)
        if self._bytes > UNIT_MAX:
            raise WireError(f"H.264 picture of more than {UNIT_MAX} bytes")
        kind = payload[0] & _TYPE
        if kind == FU_A:
            self._on_fragment(payload)
            return
        if self._fragment is not None:
            raise WireError("H.264: a NAL unit inside the fragments of another one")
        if kind in _SINGLE:
            self._units.append(payload)
        elif kind == STAP_A:
            self._units += _aggregate(payload)
        else:
            raise WireError(f"H.264 payload of type {kind}: expected a NAL unit, STAP-A or FU-A")

    def _on_fragment(self, payload: bytes) -> None:
        if len(payload) < 3:
            raise WireError("H.264 fragment: cut short")
        header = payload[1]
        # a start inside a unit, or a continuation without a start
        if bool(header & _START) == (self._fragment is not None) or header & _TYPE not in _SINGLE:
            if self._is_damaged:
                return  # the first fragment was lost, and the picture is marked as damaged already
            raise WireError("H.264 fragment: not the next one of its NAL unit")
        if self._fragment is None:
            self._fragment = bytearray((payload[0] & _REFERENCE | header & _TYPE,))
        self._fragment += payload[2:]
        if header & _END:
            self._units.append(bytes(self._fragment))
            self._fragment = None


def _aggregate(payload: bytes) -> list[bytes]:
    units, at = [], 1
    while at < len(payload):
        size = int.from_bytes(payload[at : at + 2])
        unit = payload[at + 2 : at + 2 + size]
        if not size or len(unit) < size or unit[0] & _TYPE not in _SINGLE:
            raise WireError(f"H.264 aggregate of {len(payload)} bytes: damaged at byte {at}")
        units.append(unit)
        at += 2 + size
    if not units:
        raise WireError("H.264 aggregate: empty")
    return units
