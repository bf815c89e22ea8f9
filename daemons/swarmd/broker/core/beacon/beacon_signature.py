"""Extra part of a beacon: the signature of its sender, the last part of the body.

It has two forms: with digests of former beacons, where some are signed; and where all are, one that proves
each value of the beacon also to those that did not receive it.
"""

import struct
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon_history import GROUPS_MAX
from swarmware.errors import WireError

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
SIGNATURE: Final = 6
"""Type of the part with the signature."""
VALUE_SIGNATURE: Final = 9
"""Type of the part with a signature that proves each value."""
_HEAD: Final = struct.Struct("<BI")
"""Seconds for which every beacon is signed, salt."""
_VALUE_HEAD: Final = struct.Struct("<BH")
"""Seconds for which every beacon is signed, bits 32 to 47 of the sender's clock in µs."""
_SIGNED: Final = struct.Struct("<IQ")
_PREFIX: Final = b"swarmware beacon signature 1"
"""Keeps a signature of a beacon from being one of anything else that the same key signs."""
_SIGNATURE_BYTES: Final = 64
_GROUP_BYTES: Final = 2
PART_BYTES: Final = _PART.size + _HEAD.size + GROUPS_MAX * _GROUP_BYTES + _SIGNATURE_BYTES
"""Encoded size, at most."""
VALUE_PART_BYTES: Final = _PART.size + _VALUE_HEAD.size + _SIGNATURE_BYTES
"""Encoded size of one that proves each value."""
SECONDS_MAX: Final = 255


class BeaconSignature(msgspec.Struct, frozen=True, gc=False):
    """The signature of a beacon, and what it states about the beacons before and after."""

    signs_all_s: int
    """From this beacon on, every one is signed for this number of seconds; 0: only some are."""
    salt: int
    groups: tuple[int, ...]
    """Digests of the groups of beacons before it, see `BeaconHistory.groups`."""
    value: bytes
    signed_bytes: int
    """Bytes of the body that are signed: all before `value`."""
    clock_high: int | None = None
    """Of one that proves each value: bits 32 to 47 of the sender's clock in µs, above those of the header."""


def encode_statement(signs_all_s: int, salt: int, groups: tuple[int, ...]) -> bytes:
    """Encodes the part without the signature, which follows it at the end of the body."""
    length = _HEAD.size + len(groups) * _GROUP_BYTES + _SIGNATURE_BYTES
    statement = _PART.pack(SIGNATURE, length) + _HEAD.pack(signs_all_s, salt)
    return statement + struct.pack(f"<{len(groups)}H", *groups)


def encode_value_statement(signs_all_s: int, clock_us: int) -> bytes:
    """Encodes the part that proves each value, without the signature."""
    length = _VALUE_HEAD.size + _SIGNATURE_BYTES
    return _PART.pack(VALUE_SIGNATURE, length) + _VALUE_HEAD.pack(signs_all_s, clock_us >> 32 & 0xFFFF)


def decode(data: bytes, at: int) -> BeaconSignature | None:
    """The signature in the extra parts from an offset, whose lengths fit the body; None: there is none.

    Raises: WireError when it is cut short, or not the last part.
    """
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == SIGNATURE:
            size = length - _HEAD.size - _SIGNATURE_BYTES
            if at + length != len(data) or size < 0 or size % _GROUP_BYTES:
                raise WireError(f"beacon of {len(data)} bytes: its signature is not its last part")
            signs_all_s, salt = _HEAD.unpack_from(data, at)
            groups = struct.unpack_from(f"<{size // _GROUP_BYTES}H", data, at + _HEAD.size)
            end = at + length - _SIGNATURE_BYTES
            return BeaconSignature(signs_all_s, salt, groups, data[end:], end)
        if kind == VALUE_SIGNATURE:
            if at + length != len(data) or length != _VALUE_HEAD.size + _SIGNATURE_BYTES:
                raise WireError(f"beacon of {len(data)} bytes: its signature is not its last part")
            signs_all_s, clock_high = _VALUE_HEAD.unpack_from(data, at)
            end = at + _VALUE_HEAD.size
            return BeaconSignature(signs_all_s, 0, (), data[end:], end, clock_high)
        at += length
    return None


def signed_content(hw: int, session: int, clear: bytes, body: bytes) -> bytes:
    """What the sender signs: itself, its session, the clear header, and the body before the signature."""
    return _PREFIX + _SIGNED.pack(hw, session) + clear + body
