"""Newest values of other nodes' boards: duplicate detection, and relaying beyond the range of the origin."""

import math
from collections.abc import Callable
from itertools import chain
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import HOPS_MAX, NEVER_NS, BoardValue, RelayedValue
from swarmd.broker.core.beacon.beacon_codec import relay_bytes
from swarmd.broker.core.beacon.parts.value_proof import ValueProof
from swarmd.broker.core.beacon.proof_parts import PART_HEAD_BYTES, group_bytes

PERIOD_NS: Final = 130_000_000
"""Mean period in which a value is relayed that its origin sent itself: with three of four beacons at 10 Hz.
Of 16 moving nodes each sends 4.6 kB/s, and at two hops 95 % of the poses are younger than 0.27 s; of 100
nodes 7.1 kB/s and 0.29 s (tests/bench/pose_ages.py)."""
FURTHER_NS: Final = 500_000_000
"""Addition to the period for each further hop from the origin."""
REPEAT_NS: Final = 800_000_000
"""Period in which an unchanged value is relayed again; its origin repeats it every second."""
OLDEST_NS: Final = 5_000_000_000
"""A value that was not repeated for this time is not relayed any longer."""
RESTART_NS: Final = 3_000_000_000
FINE_US: Final = 200
COARSE_US: Final = 100_000
_COARSE_FROM_US: Final = 3_276_800
"""From this age on, encoded ages have steps of 0.1 s."""
FORGET_NS: Final = 60_000_000_000
ENTRY_LIMIT: Final = 8192


class RemoteValue(msgspec.Struct, frozen=True, gc=False):
    """A value of another node that was not received before."""

    origin_hw: int
    data_id: int
    stamp_us: int
    age_us: int
    """Age at reception."""
    packed: bool
    payload: bytes
    rx_ns: int


class _CachedValue:
    __slots__ = (
        "age_us",
        "changed",
        "copied_ns",
        "data_id",
        "holders",
        "hops",
        "origin_hw",
        "packed",
        "payload",
        "position",
        "proof",
        "relayed",
        "relayed_ns",
        "rx_ns",
        "stamp_us",
    )

    def __init__(self, origin_hw: int, data_id: int) -> None:
        self.origin_hw = origin_hw
        self.data_id = data_id
        self.stamp_us = -1
        self.age_us = 0
        self.payload = b""
        self.packed = False
        self.hops = 0
        self.rx_ns = 0
        self.relayed_ns = NEVER_NS
        self.relayed = False
        self.changed = False
        """The payload differs from the one relayed last."""
        self.copied_ns = NEVER_NS
        """When another node, not nearer to the origin, relayed it last."""
        self.holders: set[int] = set()
        self.proof: ValueProof | None = None
        """Valid proof of the beacon that brought the value, or None without keys."""
        self.position = 0
        """Among the values of that beacon."""


class RelayCache:
    """Newest value of each board of other nodes; selects the values to be relayed."""

    def __init__(self, *, must_prove: bool = False) -> None:
        """`must_prove`: only values with a proof are relayed, as with keys."""
        self._must_prove = must_prove
        self._entries: dict[tuple[int, int], _CachedValue] = {}
        self._relayed_ns = NEVER_NS
        self.duplicates = 0
        self.late = 0
        self.was_late = False
        """The last value given to `on_value` was older than the cached one."""

    def on_own_value(
        self,
        origin_hw: int,
        value: BoardValue,
        clock_us: int,
        rx_ns: int,
        proof: ValueProof | None = None,
        position: int = 0,
    ) -> RemoteValue | None:
        """Stores a value from a beacon of its origin; returns it, or None if the stored one is as new.

        `clock_us`: clock of the origin when it sent the value; `proof`: of the values of the beacon.
        """
        return self.on_value(
            origin_hw,
            origin_hw,
            value.data_id,
            clock_us - value.age_us,
            value.age_us,
            1,
            value.packed,
            value.payload,
            rx_ns,
            proof,
            position,
        )

    def on_relayed(self, relay_hw: int, value: RelayedValue, rx_ns: int) -> None:
        """Takes a relayed value whose origin this node receives itself; it only shows which nodes have the
        value."""
        self.was_late = False
        entry = self._entries.get((value.origin_hw, value.data_id))
        if entry is None:
            return
        if not self._is_newer(entry, value.stamp_us, value.age_us, value.payload, rx_ns):
            self._on_repeated(entry, relay_hw, value.stamp_us - entry.stamp_us, value.hops, rx_ns)
            return
        entry.holders.add(relay_hw)  # it has a newer one than this node would relay to it

    def on_value(  # noqa: PLR0913 - called for each value of a beacon, without an object for it
        self,
        sender_hw: int,
        origin_hw: int,
        data_id: int,
        stamp_us: int,
        age_us: int,
        hops: int,
        packed: bool,
        payload: bytes,
        rx_ns: int,
        proof: ValueProof | None = None,
        position: int = 0,
    ) -> RemoteValue | None:
        """Takes a value of the sender (`hops` 1) or a relayed one; returns None if it is not newer.

        `proof`: its valid proof.
        """
        entry = self._entries.get((origin_hw, data_id))
        if entry is None:
            # a member that invents origins must not take the memory of this node
            if len(self._entries) >= ENTRY_LIMIT:
                return None
            entry = self._entries[origin_hw, data_id] = _CachedValue(origin_hw, data_id)
        elif not self._is_newer(entry, stamp_us, age_us, payload, rx_ns, proof):
            is_same = payload == entry.payload and abs(stamp_us - entry.stamp_us) <= COARSE_US
            # the same value with a proof; from now on it can be relayed
            if entry.proof is None and proof is not None and is_same:
                entry.stamp_us, entry.proof, entry.position = stamp_us, proof, position
            self._on_repeated(entry, sender_hw, stamp_us - entry.stamp_us, hops, rx_ns)
            return None
        entry.changed = entry.changed or payload != entry.payload
        entry.stamp_us = stamp_us
        entry.age_us = age_us
        entry.payload = payload
        entry.packed = packed
        entry.hops = hops
        entry.rx_ns = rx_ns
        entry.relayed = False
        # only these two surely have the new value; others are added when they relay it
        entry.holders = {sender_hw, origin_hw}
        entry.proof, entry.position = proof, position
        return RemoteValue(origin_hw, data_id, stamp_us, age_us, packed, payload, rx_ns)

    def would_take(self, value: RelayedValue, rx_ns: int) -> bool:
        """Whether a relayed value is newer than the known one, or that has no proof."""
        entry = self._entries.get((value.origin_hw, value.data_id))
        if entry is None or entry.proof is None:
            return True
        return self._is_newer(entry, value.stamp_us, value.age_us, value.payload, rx_ns, value.proof)

    @staticmethod
    def _is_newer(
        entry: _CachedValue,
        stamp_us: int,
        age_us: int,
        payload: bytes,
        rx_ns: int,
        proof: ValueProof | None = None,
    ) -> bool:
        # the origin has restarted; stamps of two sessions cannot be compared
        if proof is not None and entry.proof is not None and proof.session != entry.proof.session:
            return proof.session > entry.proof.session
        ahead_us = stamp_us - entry.stamp_us
        # ages have a coarser unit in beacons when they are long
        rounding_us = FINE_US if max(age_us, entry.age_us) < _COARSE_FROM_US else COARSE_US
        if ahead_us > rounding_us:
            return True
        if ahead_us > 0:
            return payload != entry.payload  # ages are rounded: the same value may appear slightly newer
        if proof is not None and entry.proof is not None:
            return False  # of the same clock
        # far behind, and nothing newer for long: the origin's clock was restarted
        return ahead_us < -OLDEST_NS // 1000 and rx_ns - entry.rx_ns > RESTART_NS

    def newest(self, origin_hw: int, data_id: int) -> RemoteValue | None:
        """The newest value of a board, or None if no value is cached."""
        entry = self._entries.get((origin_hw, data_id))
        if entry is None:
            return None
        return RemoteValue(
            origin_hw, data_id, entry.stamp_us, entry.age_us, entry.packed, entry.payload, entry.rx_ns
        )

    def _on_repeated(self, entry: _CachedValue, sender_hw: int, ahead_us: int, hops: int, rx_ns: int) -> None:
        self.was_late = ahead_us < -COARSE_US
        if self.was_late:
            self.late += 1
            return
        self.duplicates += 1
        entry.holders.add(sender_hw)
        # a node behind this one has relayed it; the neighbours there have the value
        if hops > entry.hops:
            entry.copied_ns = rx_ns
            return
        # from the origin, or from a node nearer to it: the value is confirmed
        entry.hops = hops
        entry.age_us += (rx_ns - entry.rx_ns) // 1000
        entry.rx_ns = rx_ns
        # an unchanged value is relayed again now and then, for nodes that have come into range since
        if rx_ns - entry.relayed_ns >= REPEAT_NS:
            entry.relayed = False

    def compose(
        self, now_ns: int, room: int, common: frozenset[int], needed: Callable[[int, set[int]], bool]
    ) -> list[RelayedValue]:
        """Relayed values for the next beacon in at most `room` bytes.

        `common`: nodes that all neighbours receive. `needed(origin, holders)`: whether some neighbour
        neither receives the origin nor has the value. Priority is the time since the last relay, in
        periods of its distance, by the root of the distance: near values go first where room is short.
        """
        due = [
            (self._waited(entry, now_ns) / math.sqrt(entry.hops), entry)
            for entry in self._entries.values()
            if self._is_due(entry, now_ns, common)
        ]
        due.sort(key=_first, reverse=True)
        groups: dict[int, list[RelayedValue]] = {}
        for _, entry in due:
            proof = entry.proof
            # values of one beacon share its signature, so the first one of a group costs most bytes
            group = groups.get(id(proof), [])
            size = relay_bytes(entry.payload)
            if proof is not None:
                size += _more_bytes(proof, group, entry.position) + (0 if groups else PART_HEAD_BYTES)
            # a smaller value behind it may still fit
            if size > room:
                continue
            if not needed(entry.origin_hw, entry.holders):
                entry.relayed_ns = max(entry.relayed_ns, entry.copied_ns)  # others relay it in turn
                continue
            room -= size
            entry.relayed = True
            entry.changed = False
            self._relayed_ns = now_ns
            period_ns = _period_ns(entry)
            late_ns = now_ns - entry.relayed_ns - period_ns
            entry.relayed_ns = now_ns - (late_ns if late_ns < period_ns else 0)  # keeps the mean period
            age_us = entry.age_us + (now_ns - entry.rx_ns) // 1000
            relay = RelayedValue(
                entry.origin_hw,
                entry.data_id,
                entry.stamp_us,
                age_us,
                entry.hops + 1,
                entry.packed,
                entry.payload,
                proof,
                entry.position if proof is not None else 0,
            )
            groups[id(proof)] = [*group, relay]
        return list(chain.from_iterable(groups.values()))

    def has_changes(
        self, now_ns: int, common: frozenset[int], needed: Callable[[int, set[int]], bool]
    ) -> bool:
        """Whether `compose` would relay a changed value; an unchanged one waits for the next beacon."""
        return any(
            entry.changed and self._is_due(entry, now_ns, common) and needed(entry.origin_hw, entry.holders)
            for entry in self._entries.values()
        )

    def _is_due(self, entry: _CachedValue, now_ns: int, common: frozenset[int]) -> bool:
        # all neighbours receive the origin itself, or the value was relayed already
        if entry.relayed or entry.origin_hw in common or entry.hops >= HOPS_MAX:
            return False
        if self._must_prove and entry.proof is None:
            return False
        return now_ns - entry.rx_ns <= OLDEST_NS and self._waited(entry, now_ns) >= 1.0

    @staticmethod
    def _waited(entry: _CachedValue, now_ns: int) -> float:
        """Time since the last relay, in periods of its distance."""
        return (now_ns - entry.relayed_ns) / _period_ns(entry)

    def relayed_recently(self, now_ns: int) -> bool:
        """Whether a value was relayed within the last second."""
        return now_ns - self._relayed_ns < 1_000_000_000

    def forget(self, now_ns: int) -> None:
        """Removes values that were not received for a minute."""
        old = [key for key, entry in self._entries.items() if now_ns - entry.rx_ns > FORGET_NS]
        for key in old:
            del self._entries[key]

    def forget_origin(self, origin_hw: int) -> None:
        """Removes the values of a restarted origin: stamps of its former clock are not comparable."""
        for key in [key for key in self._entries if key[0] == origin_hw]:
            del self._entries[key]


def _period_ns(entry: _CachedValue) -> int:
    return PERIOD_NS + FURTHER_NS * (entry.hops - 1)


def _more_bytes(proof: ValueProof, group: list[RelayedValue], position: int) -> int:
    """Bytes that a value adds to the proof of those that are relayed already."""
    before = [relay.position for relay in group]
    return group_bytes(proof, [*before, position]) - (group_bytes(proof, before) if before else 0)


def _first(entry: tuple[float, _CachedValue]) -> float:
    return entry[0]
