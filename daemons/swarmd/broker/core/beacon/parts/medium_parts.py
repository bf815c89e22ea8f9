"""Extra part of a beacon about media: by which ones the sender receives whom."""

import struct
from collections.abc import Iterable
from typing import Final, NamedTuple

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_MEDIA: Final = 7
"""Type of the part with media."""
_LISTING: Final = struct.Struct("<IHB")
LISTING_BYTES: Final = _LISTING.size


class MediumListing(NamedTuple):
    """How well the sender receives a node by one medium."""

    hw: int
    medium: int
    """Number of the medium: BLAKE2b-16 of its name, which is the same at both ends."""
    quality: int
    """Share of the node's datagrams that arrived, in 1/255, or 0 if this medium brings none."""


def media_bytes(count: int) -> int:
    """Encoded size of `count` listings."""
    return _PART.size + count * LISTING_BYTES if count else 0


def encode_media(listings: Iterable[MediumListing]) -> bytes:
    """Encodes listings as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    body = b"".join([_LISTING.pack(*listing) for listing in listings])
    return _PART.pack(_MEDIA, len(body)) + body


def decode_media(data: bytes, at: int) -> tuple[MediumListing, ...]:
    """Listings in the extra parts from an offset, whose lengths fit the body.

    Raises: struct.error when one is cut short.
    """
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _MEDIA:
            return tuple([MediumListing(*one) for one in _LISTING.iter_unpack(data[at : at + length])])
        at += length
    return ()
