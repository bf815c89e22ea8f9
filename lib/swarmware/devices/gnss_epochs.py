"""Positions of one receiver in several messages of an epoch: one fix of each epoch, of the best message."""

import math
from typing import Final

import msgspec

from swarmware.types.vehicle import GnssFix

KINDS: Final = ("PVT", "GGA", "GNS", "RMC", "GLL")
"""Messages with a position, the best one first: RMC and GLL have neither height, dilution nor satellites."""
_WITH_HEIGHT: Final = frozenset(KINDS[:3])
_DAY_S: Final = 86_400.0


class Position(msgspec.Struct, frozen=True):
    """Content of one message with a position."""

    kind: str
    """Kind of the message, from `KINDS`."""
    time_s: float
    """Time of day, UTC."""
    fix: GnssFix | None
    """The fix, or None if the receiver has none."""
    reason: str = ""
    """Why the receiver has no fix."""


def between_s(one_s: float, other_s: float) -> float:
    """Time between two times of day, at most half a day: an epoch after midnight follows one before."""
    return abs(math.remainder(one_s - other_s, _DAY_S))


class Epochs:
    """Selects the message that gives the fix of each epoch.

    A message gives no fix while a better kind arrives, even if that says "no fix". A message without height
    must arrive twice before it counts: the better message of the same epoch may follow it.
    """

    def __init__(self) -> None:
        self._counts = dict.fromkeys(KINDS, 0)
        """Messages of each kind since the last one of a better kind."""
        self._best = len(KINDS)
        """Rank of the best kind so far."""
        self._last: Position | None = None

    def take(self, position: Position) -> GnssFix | None:
        """The fix of the epoch, or None if another message gives it or the receiver has no fix."""
        rank = KINDS.index(position.kind)
        self._best = min(self._best, rank)
        self._counts[position.kind] += 1
        for lesser in KINDS[rank + 1 :]:
            self._counts[lesser] = 0
        needed = 1 if rank == self._best and position.kind in _WITH_HEIGHT else 2
        if position.fix is None or self._counts[position.kind] < needed or self._is_repeated(position):
            return None
        self._last = position
        return position.fix

    def _is_repeated(self, position: Position) -> bool:
        """Whether another message gave the fix of this epoch, and this one adds no height."""
        last = self._last
        if last is None or last.kind == position.kind or last.time_s != position.time_s:
            return False
        return last.fix is None or last.fix.has_height or position.kind not in _WITH_HEIGHT
