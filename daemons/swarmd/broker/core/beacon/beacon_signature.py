"""Extra part of a beacon: the signature of its sender, the last part of the body."""

import struct
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon_history import GROUPS_MAX
from swarmware.errors import WireError

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
SIGNATURE: Final = 6
"""Type of the part with the signature."""
_HEAD: Final = struct.Struct("<BI")
"""Seconds for which every beacon is signed, salt."""
_SIGNED: Final = struct.Struct("<IQ")
_PREFIX: Final = b"swarmware beacon signature 1"
"""Keeps a signature of a beacon from being one of anything else that the same key signs."""
_SIGNATURE_BYTES: Final = 64
_GROUP_BYTES: Final = 2
PART_BYTES: Final = _PART.size + _HEAD.size + GROUPS_MAX * _GROUP_BYTES + _SIGNATURE_BYTES
"""Encoded size, at most."""
BARE_PART_BYTES: Final = _PART.size + _HEAD.size + _SIGNATURE_BYTES
"""Encoded size without digests of groups."""
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


def encode_statement(signs_all_s: int, salt: int, groups: tuple[int, ...]) -> bytes:
    """Encodes the part without the signature, which follows it at the end of the body."""
    length = _HEAD.size + len(groups) * _GROUP_BYTES + _SIGNATURE_BYTES
    statement = _PART.pack(SIGNATURE, length) + _HEAD.pack(signs_all_s, salt)
    return statement + struct.pack(f"<{len(groups)}H", *groups)


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
        at += length
    return None


def signed_content(hw: int, session: int, clear: bytes, body: bytes) -> bytes:
    """What the sender signs: itself, its session, the clear header, and the body before the signature."""
    return _PREFIX + _SIGNED.pack(hw, session) + clear + body
