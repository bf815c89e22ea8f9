"""The proof of a value of a signed beacon for nodes that did not receive the beacon.

The sender signs a hash of the whole beacon and the root of a tree of hashes, whose leaves are the hashes of
its values. A node that relays some of them adds both and the hashes of the other branches.
"""

import struct
from collections.abc import Collection, Sequence
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.footprint.blake2b import blake2b

HASH_BYTES: Final = 16
SIGNATURE_BYTES: Final = 64
_STAMP_MASK: Final = 0xFFFF_FFFF_FFFF
_SIGNED: Final = struct.Struct("<IQ")
_VALUE: Final = struct.Struct("<IQB")
_PREFIX: Final = b"swarmware beacon signature 2"
"""Keeps a signature of values from being one of anything else that the same key signs."""
_BODY: Final = b"sw beacon body 2"
_LEAF: Final = b"sw beacon value2"
_NODE: Final = b"sw beacon node 2"
"""Persons of BLAKE2b: a leaf and an inner node with the same bytes have different hashes."""
_NO_VALUES: Final = bytes(HASH_BYTES)

Span = tuple[int, int]
"""Positions of values in a beacon: from the first to before the second."""


class ValueProof(msgspec.Struct, frozen=True):
    """The signature of a beacon, and the hashes that lead from its values to what is signed."""

    session: int
    """Session of the sender's broker."""
    body: bytes
    """Hash of the clear header, and of the body before the signature."""
    count: int
    """Number of values in the beacon."""
    hashes: dict[Span, bytes]
    """Hashes of the values and branches that are known."""
    signature: bytes

    def signed_content(self, hw: int) -> bytes:
        """The bytes that the sender with this hardware id signed."""
        return signed_content(hw, self.session, self.body, self.hashes.get((0, self.count), _NO_VALUES))

    def further(self, positions: Collection[int]) -> list[bytes]:
        """The hashes that a receiver of the values at these positions needs, from the first branch on."""
        found: list[bytes] = []
        self._further((0, self.count), positions, found)
        return found

    def _further(self, span: Span, positions: Collection[int], found: list[bytes]) -> None:
        first, end = span
        if not any(first <= position < end for position in positions):
            found.append(self.hashes[span])
        elif end - first > 1:
            middle = _middle(span)
            self._further((first, middle), positions, found)
            self._further((middle, end), positions, found)


def value_hash(data_id: int, stamp_us: int, packed: bool, payload: bytes) -> bytes:
    """Hash of a value; `stamp_us`: on its origin's clock."""
    content = _VALUE.pack(data_id, stamp_us & _STAMP_MASK, packed) + payload
    return blake2b(content, digest_size=HASH_BYTES, person=_LEAF).digest()


def body_hash(clear: bytes, body: bytes) -> bytes:
    """Hash of the clear header and of the body before the signature."""
    return blake2b(clear + body, digest_size=HASH_BYTES, person=_BODY).digest()


def signed_content(hw: int, session: int, body: bytes, root: bytes) -> bytes:
    """The bytes that the sender signs; `root`: see `ValueProof`."""
    return _PREFIX + _SIGNED.pack(hw, session) + body + root


def prove(session: int, body: bytes, leaves: Sequence[bytes], signature: bytes) -> ValueProof:
    """The proof of all values of a beacon; `leaves`: their hashes."""
    hashes = {(position, position + 1): leaf for position, leaf in enumerate(leaves)}
    if leaves:
        _complete((0, len(leaves)), hashes)
    return ValueProof(session, body, len(leaves), hashes, signature)


def restore(
    session: int, body: bytes, count: int, leaves: dict[int, bytes], further: bytes, signature: bytes
) -> tuple[ValueProof, int]:
    """The proof of some values, by their positions, and how many bytes of `further` it needed.

    Raises: WireError when positions and hashes do not fit together.
    """
    if not leaves or not all(position < count for position in leaves):
        raise WireError(f"proof of {len(leaves)} values among {count}: expected positions below {count}")
    hashes = {(position, position + 1): leaf for position, leaf in leaves.items()}
    used = _take((0, count), leaves, further, 0, hashes)
    _complete((0, count), hashes)
    return ValueProof(session, body, count, hashes, signature), used


def _take(span: Span, leaves: Collection[int], further: bytes, at: int, hashes: dict[Span, bytes]) -> int:
    first, end = span
    if not any(first <= position < end for position in leaves):
        hashes[span] = further[at : at + HASH_BYTES]
        if len(hashes[span]) < HASH_BYTES:
            raise WireError(f"proof of {len(leaves)} values: cut short after {len(further)} bytes of hashes")
        return at + HASH_BYTES
    if end - first > 1:
        middle = _middle(span)
        at = _take((first, middle), leaves, further, at, hashes)
        at = _take((middle, end), leaves, further, at, hashes)
    return at


def _complete(span: Span, hashes: dict[Span, bytes]) -> bytes:
    """Adds the hashes of the branches in a span; returns the hash of the span."""
    known = hashes.get(span)
    if known is None:
        middle = _middle(span)
        both = _complete((span[0], middle), hashes) + _complete((middle, span[1]), hashes)
        known = hashes[span] = blake2b(both, digest_size=HASH_BYTES, person=_NODE).digest()
    return known


def _middle(span: Span) -> int:
    return (span[0] + span[1] + 1) // 2
