"""Seals datagrams between a session of this node and one of a neighbour, with keys of this pair only."""

import struct
from typing import Final

import msgspec

from swarmware.footprint.blake2b import blake2b
from swarmware.transport.security.seal import Opened, ReceivedSession, Refusal
from swarmware.transport.sodium import KEY_BYTES, SealKey, curve_shared

_PERSON: Final = b"swarmware pair 1"
_ENDS: Final = struct.Struct("<IQIQ")
_NONCE: Final = struct.Struct("<II4x")
PAIR_WINDOW: Final = 1024
"""Maximum reordering of datagrams: the sender counts its datagrams to all neighbours together, so two
datagrams to one neighbour may be many numbers apart."""


class PairEnd(msgspec.Struct, frozen=True):
    """One end of a pair: a session of a node and its public key."""

    hw: int
    session: int
    curve_public: bytes


class PairSeal:
    """Both directions between this node and a neighbour, each with a key of its own.

    The keys are of both sessions: a datagram of a former session of either node cannot be opened. The
    sequence number is the nonce; the caller uses each number once for one pair of sessions.
    """

    def __init__(self, curve_secret: bytes, own: PairEnd, other: PairEnd) -> None:
        """Raises: InvalidInput when the bytes of the other end are not a key."""
        shared = curve_shared(curve_secret, other.curve_public)
        self.other = other
        self._own_hw = own.hw
        self._seal = _key(shared, own, other).seal
        self._received = ReceivedSession(other.session, _key(shared, other, own), PAIR_WINDOW)

    def seal(self, sequence: int, clear: bytes, body: bytes) -> bytes:
        """The body encrypted, with a tag over it and the clear header."""
        return self._seal(_NONCE.pack(self._own_hw, sequence), body, clear)

    def open(self, sequence: int, clear: bytes, box: bytes) -> Opened | Refusal:
        """The body that the other node sealed, or the reason of its refusal; each datagram is opened once."""
        opened = self._received.open(self.other.hw, sequence, clear, box)
        if isinstance(opened, Opened):
            self._received.take(sequence)
        return opened


def _key(shared: bytes, sender: PairEnd, receiver: PairEnd) -> SealKey:
    ends = _ENDS.pack(sender.hw, sender.session, receiver.hw, receiver.session)
    return SealKey(
        blake2b(
            ends + sender.curve_public + receiver.curve_public,
            key=shared,
            person=_PERSON,
            digest_size=KEY_BYTES,
        ).digest()
    )
