"""Extra part of a beacon: the signature of its sender, the last part of the body.

It proves the beacon to those that receive it, and each value of it to those that do not, see `value_proof`.
"""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
SIGNATURE: Final = 9
"""Type of the part with the signature."""
_CLOCK: Final = struct.Struct("<H")
"""Bits 32 to 47 of the sender's clock in µs."""
_SIGNATURE_BYTES: Final = 64
PART_BYTES: Final = _PART.size + _CLOCK.size + _SIGNATURE_BYTES
"""Encoded size."""


class BeaconSignature(msgspec.Struct, frozen=True, gc=False):
    """The signature of a beacon."""

    value: bytes
    signed_bytes: int
    """Bytes of the body that are signed: all before `value`."""
    clock_high: int
    """Bits 32 to 47 of the sender's clock in µs; the header has the 32 bits below."""


def encode_statement(clock_us: int) -> bytes:
    """Encodes the part without the signature, which follows it at the end of the body."""
    return _PART.pack(SIGNATURE, _CLOCK.size + _SIGNATURE_BYTES) + _CLOCK.pack(clock_us >> 32 & 0xFFFF)


def decode(data: bytes, at: int) -> BeaconSignature | None:
    """The signature in the extra parts from an offset, whose lengths fit the body, or None without one.

    Raises: WireError when it is cut short, or not the last part.
    """
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == SIGNATURE:
            if at + length != len(data) or length != _CLOCK.size + _SIGNATURE_BYTES:
                raise WireError(f"beacon of {len(data)} bytes: its signature is not its last part")
            (clock_high,) = _CLOCK.unpack_from(data, at)
            end = at + _CLOCK.size
            return BeaconSignature(data[end:], end, clock_high)
        at += length
    return None
