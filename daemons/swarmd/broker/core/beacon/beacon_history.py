"""The last beacons of one session, as digests: of the own ones, and of those taken from another node."""

import struct
from array import array
from collections.abc import Sequence
from typing import Final

from swarmware.model.digest import blake2b

HISTORY: Final = 64
"""Beacons that are remembered: the replay window."""
GROUP: Final = 8
"""Beacons with one group digest; a receiver compares a group of which it has taken all."""
GROUPS_MAX: Final = 7
"""Groups that a signature names: 5.6 s at 10 Hz, a little more than the period of signatures."""
_GROUP_DIGEST_BYTES: Final = 2
"""A false beacon is overlooked once in 65 536 times: the salt is not known when it is made."""
_DIGEST_BYTES: Final = 8
_UNKNOWN: Final = 0
_SALTED: Final = struct.Struct(f"<I{GROUP}Q")


def datagram_digest(data: bytes) -> int:
    """Digest of a whole datagram, as it is on the wire; not 0."""
    return int.from_bytes(blake2b(data, digest_size=_DIGEST_BYTES).digest(), "little") or 1


class BeaconHistory:
    """Digests of the last beacons, by sequence number."""

    __slots__ = ("_digests", "top")

    def __init__(self) -> None:
        self._digests = array("Q", [_UNKNOWN]) * HISTORY
        self.top = -1
        """Highest number so far; -1: none."""

    def record(self, sequence: int, digest: int) -> None:
        """Remembers a beacon; one that is older than the last HISTORY is not remembered."""
        ahead = sequence - self.top
        if ahead <= -HISTORY:
            return
        if self.top >= 0:
            for missed in range(max(self.top + 1, sequence - HISTORY + 1), sequence):
                self._digests[missed % HISTORY] = _UNKNOWN
        self._digests[sequence % HISTORY] = digest
        self.top = max(self.top, sequence)

    def digest(self, sequence: int) -> int | None:
        """Digest of a beacon; None: it is not remembered, or was never there."""
        if not self.top - HISTORY < sequence <= self.top:
            return None
        return self._digests[sequence % HISTORY] or None

    def groups(self, salt: int, below: int) -> tuple[int | None, ...]:
        """Salted digests of the complete groups before a sequence number, the newest first; None: not all
        beacons of it are remembered."""
        first = below // GROUP - 1
        return tuple(self._group(salt, number) for number in range(first, first - GROUPS_MAX, -1))

    def contradicts(self, salt: int, below: int, stated: Sequence[int]) -> bool:
        """Whether beacons that were taken are others than those of which the sender states the digests."""
        return any(
            own is not None and own != other
            for own, other in zip(self.groups(salt, below), stated, strict=False)
        )

    def _group(self, salt: int, number: int) -> int | None:
        first = number * GROUP
        if first <= self.top - HISTORY or first < 0 or first + GROUP > self.top + 1:
            return None
        at = first % HISTORY
        digests = self._digests[at : at + GROUP]
        if _UNKNOWN in digests:
            return None
        salted = _SALTED.pack(salt, *digests)
        return int.from_bytes(blake2b(salted, digest_size=_GROUP_DIGEST_BYTES).digest(), "little")
