"""Binary frames of u-blox receivers (UBX), and the position in NAV-PVT."""

import math
import struct
from typing import Final

import msgspec

from swarmware.devices.gnss_epochs import Position
from swarmware.errors import WireError
from swarmware.types.vehicle import GnssFix

SYNC: Final = b"\xb5\x62"
HEADER_BYTES: Final = 6
"""Sync, class, identifier, and the length of the payload."""
CHECKSUM_BYTES: Final = 2
PAYLOAD_BYTES: Final = 1024
"""Longest payload that is taken; NAV-SAT of 80 satellites has 968 bytes."""
NAV_PVT: Final = (0x01, 0x07)
"""Class and identifier of the message with position, velocity and time."""
_HEADER: Final = struct.Struct("<2sBBH")
_PVT: Final = struct.Struct("<8x3B5xi2BxB3i4xI34xB")
"""Hour, minute, second; nanoseconds; type and flags of the fix; satellites; longitude, latitude and height;
horizontal accuracy; `flags3`."""
_PVT_BYTES: Final = 84
"""Length of NAV-PVT of u-blox 7; later ones append fields."""
_FIX_TYPES: Final = {0: "no fix", 1: "dead reckoning", 5: "time only"}
"""Types of NAV-PVT without a position that was measured."""
_TWO_DIMENSIONS: Final = 2
_FIX_OK: Final = 0x01
"""Bit of `flags`: the fix is within the limits of the receiver."""
_INVALID: Final = 0x01
"""Bit of `flags3`: longitude, latitude and height are invalid."""


class UbxFrame(msgspec.Struct, frozen=True):
    """Content of one frame."""

    message: tuple[int, int]
    """Class and identifier."""
    payload: bytes


def checksum(body: bytes) -> bytes:
    """Fletcher checksum of class, identifier, length and payload.

    Source: RFC 1145, in 8 bit; u-blox M8 receiver description, 32.4.
    """
    first = second = 0
    for byte in body:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return bytes((first, second))


def frame(message: tuple[int, int], payload: bytes) -> bytes:
    """The frame of a message."""
    whole = _HEADER.pack(SYNC, *message, len(payload)) + payload
    return whole + checksum(whole[len(SYNC) :])


def frame_bytes(opened: bytes) -> int | None:
    """Length of the frame that begins with these bytes, or None before its header has arrived.

    Raises: WireError when no frame begins so, or a longer one than is taken.
    """
    if not opened.startswith(SYNC[: len(opened)]):
        raise WireError("UBX: no frame")
    # the length is unknown until the header has arrived
    if len(opened) < HEADER_BYTES:
        return None
    payload_bytes = int(_HEADER.unpack_from(opened)[3])
    # a damaged length would make the reader wait for kilobytes that never come
    if payload_bytes > PAYLOAD_BYTES:
        raise WireError(f"UBX: longer than {PAYLOAD_BYTES} bytes")
    return HEADER_BYTES + payload_bytes + CHECKSUM_BYTES


def frame_of(found: bytes) -> UbxFrame:
    """The content of a whole frame. Raises: WireError."""
    if found[-CHECKSUM_BYTES:] != checksum(found[len(SYNC) : -CHECKSUM_BYTES]):
        raise WireError("UBX: checksum wrong")
    return UbxFrame((found[2], found[3]), found[HEADER_BYTES:-CHECKSUM_BYTES])


def position(found: UbxFrame) -> Position | None:
    """The position in a frame, or None if the message has no position that is used. Raises: WireError."""
    return nav_pvt(found.payload) if found.message == NAV_PVT else None


def nav_pvt(payload: bytes) -> Position:
    """The position in NAV-PVT. Raises: WireError. Source: u-blox M8 receiver description, 32.17.14."""
    if len(payload) < _PVT_BYTES:
        raise WireError(f"NAV-PVT of {len(payload)} bytes, expected {_PVT_BYTES} or more")
    (
        hour,
        minute,
        second,
        nano_ns,
        fix_type,
        flags,
        satellites,
        lon_e7,
        lat_e7,
        height_mm,
        accuracy_mm,
        flags3,
    ) = _PVT.unpack_from(payload)
    time_s = (hour * 60 + minute) * 60 + second + nano_ns / 1e9
    if fix_type in _FIX_TYPES or not flags & _FIX_OK or flags3 & _INVALID:
        what = _FIX_TYPES.get(fix_type, "the receiver does not trust its fix")
        return Position("PVT", time_s, None, f"NAV-PVT: {what}")
    if satellites == 0:
        raise WireError("NAV-PVT: a fix without satellites")
    if abs(lat_e7) > 90e7 or abs(lon_e7) > 180e7:
        raise WireError("NAV-PVT: position out of range")
    # zero would make the estimator trust this fix above everything else
    if accuracy_mm == 0:
        raise WireError("NAV-PVT: a fix without accuracy")
    height_m = math.nan if fix_type == _TWO_DIMENSIONS else height_mm / 1e3
    return Position(
        "PVT", time_s, GnssFix(lat_e7 / 1e7, lon_e7 / 1e7, height_m, accuracy_mm / 1e3, satellites)
    )
