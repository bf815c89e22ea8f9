"""Relayed values of a board whose origin is received itself: its own beacons decide whether they are true.

Only beacons of the origin bring values of its boards into the swarm, and every receiver of a beacon computes
the same stamp from it. So a relayed value that is newer than the newest one of a node that missed no beacon
must be that of the next beacon, with the same stamp and the same payload.
"""

from collections.abc import Iterable
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon.beacon import (
    NEVER_NS,
    BoardValue,
    RelayedValue,
    decode_age,
    encode_age,
)

LEAD_US: Final = 1_000_000
"""A stamp this far ahead of the origin's clock, as its newest beacon shows it, is of no value that exists:
the delay of one datagram is smaller."""
REPEATED_US: Final = 200_000
"""Stamps of one value that several beacons carried differ less: ages above 3.2 s have steps of 0.1 s."""
HISTORY: Final = 16
"""Consecutive beacons that must have arrived before a value counts as contradicted: a value of an older,
missed beacon is not newer than the newest, however late that beacon was stamped."""
SETTLED_NS: Final = 30_000_000_000
"""A stamp in the future does not count as contradicted for this time after the link or the origin began:
relays may still have values of the clock before a restart of the origin's computer, each of them for 5 s."""
OVERTAKEN: Final = 4
"""Beacons of the origin that a relay of a later one may overtake."""
CLAIMS_MAX: Final = 8
"""Relays of one board whose oldest undecided value is remembered."""
_WINDOW: Final = 64


class OriginBeacon(NamedTuple):
    """The beacon of an origin that has a value of its board."""

    sequence: int
    received: int
    """Which of its last 64 beacons were received; bit 0: this one. 0: it was overtaken by a later one."""
    settled: bool
    """Whether link and origin are older than SETTLED_NS."""


class Claim(NamedTuple):
    """A value that a relay states of another node's board."""

    relay_hw: int
    stamp_us: int
    hops: int
    payload: bytes
    after: int
    """Sequence number of the newest beacon of the origin when it arrived."""


class Contradiction(msgspec.Struct, frozen=True, gc=False):
    """A relayed value that the beacons of its origin contradict, or that has no valid proof."""

    relay_hw: int
    origin_hw: int
    data_id: int
    hops: int
    """Hops from the origin, as the relay states them; 2: it states that it received the origin itself."""
    is_unsigned: bool = False
    """It has no valid proof, where every beacon is signed: no member that knows the roster relays it."""


class Claims:
    """Undecided values that relays state of one board, and the newest value of the origin itself."""

    __slots__ = ("_highest_us", "_payload", "_pending", "_sequence", "_settled", "_stamp_us")

    def __init__(self) -> None:
        self._stamp_us = self._highest_us = 0
        self._payload = b""
        self._sequence = -1
        self._settled = False
        self._pending: dict[int, Claim] = {}
        """By relay, the oldest one of each: one that is always ahead of the origin is decided, too."""

    def on_own(self, beacon: OriginBeacon, stamp_us: int, payload: bytes) -> tuple[list[Claim], list[Claim]]:
        """Takes a value from the origin itself; returns the claims that it contradicts, and those that it
        confirms."""
        false: list[Claim] = []
        true: list[Claim] = []
        for claim in tuple(self._pending.values()) if self._pending else ():
            ahead_us = claim.stamp_us - stamp_us
            if ahead_us == 0 and claim.payload == payload:
                true.append(claim)
            elif ahead_us > 0 and beacon.sequence < claim.after + OVERTAKEN:
                continue  # perhaps of a later beacon
            elif not _is_repeated(claim, stamp_us, payload) and self._is_complete(beacon, claim):
                false.append(claim)
            del self._pending[claim.relay_hw]
        first = self._sequence < 0
        self._sequence, self._settled = beacon.sequence, beacon.settled
        self._stamp_us, self._payload = stamp_us, payload
        self._highest_us = stamp_us if first else max(self._highest_us, stamp_us)
        return false, true

    def _is_complete(self, beacon: OriginBeacon, claim: Claim) -> bool:
        """Whether all beacons since the claim and since the last value arrived, and HISTORY before them."""
        span = beacon.sequence - min(claim.after, self._sequence) + HISTORY
        mask = (1 << span) - 1
        return span <= _WINDOW and beacon.received & mask == mask

    def on_claim(self, claim: Claim, clock_us: int) -> bool:
        """Takes a value from a relay while the origin is received; `clock_us`: the origin's clock now.
        Returns whether it is contradicted already: no origin stamps a value in its future."""
        if self._sequence < 0 or claim.stamp_us <= self._highest_us:
            return False
        if _is_repeated(claim, self._stamp_us, self._payload):
            return False
        if claim.stamp_us - clock_us > LEAD_US:
            return self._settled
        if claim.relay_hw not in self._pending and len(self._pending) < CLAIMS_MAX:
            self._pending[claim.relay_hw] = claim
        return False

    def is_later(self, claim: Claim, clock_us: int) -> bool:
        """Whether a value is later than all those of the origin: none that another node has can be."""
        if claim.stamp_us <= self._highest_us or _is_repeated(claim, self._stamp_us, self._payload):
            return False
        return self._settled or claim.stamp_us - clock_us <= LEAD_US


class OwnClaims:
    """What relays state of the own boards: this node knows all their values."""

    def __init__(self, own_hw: int) -> None:
        self._own_hw = own_hw
        self._claims: dict[int, Claims] = {}
        self._first_ns = NEVER_NS

    def on_sent(self, values: Iterable[BoardValue], sequence: int, tx_ns: int) -> None:
        """Takes the values of a sent beacon, with the stamps that its receivers compute."""
        if self._first_ns == NEVER_NS:
            self._first_ns = tx_ns
        beacon = OriginBeacon(sequence, 0, tx_ns - self._first_ns > SETTLED_NS)
        for value in values:
            claims = self._claims.get(value.data_id)
            if claims is None:
                claims = self._claims[value.data_id] = Claims()
            claims.on_own(beacon, tx_ns // 1000 - decode_age(encode_age(value.age_us)), value.payload)

    def on_claim(self, relay_hw: int, value: RelayedValue, now_ns: int) -> Contradiction | None:
        """Takes a relayed value of an own board; None: it can be true."""
        claims = self._claims.get(value.data_id)
        claim = Claim(relay_hw, value.stamp_us, value.hops, value.payload, 0)
        if claims is None or not claims.is_later(claim, now_ns // 1000):
            return None
        return Contradiction(relay_hw, self._own_hw, value.data_id, value.hops)


def _is_repeated(claim: Claim, stamp_us: int, payload: bytes) -> bool:
    """Whether it is the same value, from another beacon of its origin."""
    return claim.payload == payload and abs(claim.stamp_us - stamp_us) <= REPEATED_US
