"""Relayed values: only what its origin has signed is taken, and relayed."""

from collections.abc import Callable, Iterable
from typing import Final

import msgspec
import pytest
from tests.unit.broker.signed_beacons import NAMES, SESSION, Member, SealedBeacon, checks_of

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, RelayedValue
from swarmd.broker.core.boards.received_values import ReceivedValues
from swarmd.broker.core.boards.relay_cache import FURTHER_NS, PERIOD_NS, RelayCache
from swarmd.broker.core.membership.signatures import signature_checks
from swarmd.broker.core.membership.signatures.signature_checks import REMEMBERED
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.traffic import Counters
from swarmware.model.names import hardware_id
from swarmware.transport.sodium import verify
from swarmware.types.net import BoardSubscription

TRIES: Final = 1000
PERIOD: Final = 200_000_000
UAV1, UAV2, UAV3 = NAMES
POSE: Final = 1
"""Number of the first board of `Member`."""
ROOM: Final = 1100


def needed(_origin_hw: int, _holders: set[int]) -> bool:
    return True


class Origin(Member):
    """uav1, whose boards are relayed."""

    def __init__(self, *, session: int = SESSION, key: str = "") -> None:
        super().__init__("uav1", session=session, key=key)
        self.sequence = 100

    def values(self, now_ns: int, *payloads: bytes) -> SealedBeacon:
        """A beacon with the values of some boards."""
        self.sequence += 1
        return self.beacon(self.sequence, now_ns, *payloads)


class Relay:
    """uav2, which receives uav1 itself."""

    def __init__(self) -> None:
        self.cache = RelayCache(must_prove=True)

    def hear(self, sent: SealedBeacon, now_ns: int, *, proven: bool = True) -> None:
        checked = sent.checked(checks_of("uav2"))
        assert checked.is_genuine
        proof = checked.proof if proven else None
        for position, value in enumerate(sent.beacon.values):
            self.cache.on_own_value(UAV1, value, now_ns // 1000, now_ns, proof, position)

    def say(self, now_ns: int, room: int = ROOM) -> tuple[RelayedValue, ...]:
        """What its next beacon relays, after its way through the air."""
        relays = tuple(self.cache.compose(now_ns, room, frozenset(), needed))
        body = codec.encode(Beacon(relays=relays))
        assert len(body) <= room + 2
        return codec.decode(body).relays


class Receiver:
    """uav3, which does not receive uav1."""

    def __init__(self) -> None:
        self.cache = RelayCache(must_prove=True)
        self.counters = Counters()
        self._received = ReceivedValues(UAV3, self.cache, self.counters, lambda _: None, checks_of("uav3"))
        self._received.subscribe(
            [BoardSubscription("uav1", "nav/pose", "Pose", POSE + number) for number in range(9)]
        )

    def take(self, relays: Iterable[RelayedValue], now_ns: int) -> list[bytes]:
        beacon = Beacon(relays=tuple(relays))
        taken = self._received.take(Neighbour(UAV2, now_ns), beacon, now_ns)
        return [value.payload for _, value in taken]

    @property
    def refused(self) -> int:
        return self.counters.refused.unsigned_values

    def reported(self) -> list[tuple[int, int]]:
        """Relay and origin of each refused value since the last call."""
        found, self._received.unsigned = self._received.unsigned, []
        return [(each.relay_hw, each.origin_hw) for each in found]


def test_true_values_over_relays_need_one_signature(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    verified: list[bytes] = []

    def counting(public: bytes, signature: bytes, data: bytes) -> bool:
        verified.append(signature)
        return verify(public, signature, data)

    monkeypatch.setattr(signature_checks, "verify", counting)
    origin, relay, receiver, last = Origin(), Relay(), Receiver(), Receiver()
    for step in range(1, 20):
        now_ns = step * (PERIOD_NS + FURTHER_NS)
        payloads = [bytes((step, board)) for board in range(4)]
        relay.hear(origin.values(now_ns, *payloads), now_ns)
        assert sorted(receiver.take(relay.say(now_ns), now_ns)) == payloads
        assert receiver.take(relay.say(now_ns), now_ns) == [], "once"
        further = receiver.cache.compose(now_ns, ROOM, frozenset(), needed)
        assert sorted(last.take(further, now_ns)) == payloads
    assert receiver.refused == last.refused == 0
    assert len(verified) == 19 * 3, "once at each of the three"


def stolen(relay: RelayedValue, number: int) -> RelayedValue:
    return msgspec.structs.replace(relay, payload=b"invented", stamp_us=relay.stamp_us + 1000 * (number + 1))


def reproved(relay: RelayedValue, number: int, key: str, session: int = SESSION) -> RelayedValue:
    """The invented value in a beacon that the relay signs in the name of the origin, or in its own."""
    forger = Origin(key=key, session=session)
    now_ns = (relay.stamp_us + 2000 * (number + 1)) * 1000
    sent = forger.values(now_ns, b"invented")
    proof = signature_checks._proof(sent.header, sent.beacon, sent.clear, sent.body)
    stamp_us = now_ns // 1000 - 1000
    return msgspec.structs.replace(
        relay, data_id=POSE, payload=b"invented", stamp_us=stamp_us, proof=proof, position=0
    )


INVENTIONS: Final[dict[str, Callable[[RelayedValue, int], RelayedValue]]] = {
    "without a proof": lambda relay, number: msgspec.structs.replace(stolen(relay, number), proof=None),
    "with the key of the relay": lambda relay, number: reproved(relay, number, "uav2"),
    "in another session": lambda relay, number: reproved(relay, number, "uav2", SESSION + number),
    "of another member": lambda relay, number: msgspec.structs.replace(
        relay, origin_hw=UAV2, payload=b"%d" % number
    ),
}


@pytest.mark.parametrize("invention", INVENTIONS)
def test_thousand_invented_values_are_refused_and_reported(invention: str) -> None:
    origin, relay, receiver = Origin(), Relay(), Receiver()
    relay.hear(origin.values(PERIOD, b"true"), PERIOD)
    [true] = relay.say(PERIOD)
    assert receiver.take([true], PERIOD) == [b"true"]
    for number in range(TRIES):
        assert receiver.take([INVENTIONS[invention](true, number)], PERIOD + number) == []
    assert receiver.refused == TRIES
    victim = UAV2 if invention == "of another member" else UAV1
    assert receiver.reported() == [(UAV2, victim)] * TRIES
    relay.hear(origin.values(9 * PERIOD, b"next"), 9 * PERIOD)
    assert receiver.take(relay.say(9 * PERIOD), 9 * PERIOD) == [b"next"]


def test_changed_value_under_true_proof_is_refused() -> None:
    origin, relay, receiver = Origin(), Relay(), Receiver()
    relay.hear(origin.values(PERIOD, b"true", b"also"), PERIOD)
    true, _ = relay.say(PERIOD)
    for number in range(TRIES):
        on_wire = codec.decode(codec.encode(Beacon(relays=(stolen(true, number),)))).relays
        assert receiver.take(on_wire, PERIOD) == []
    assert receiver.refused == TRIES


def test_recorded_value_replaces_no_newer_value() -> None:
    origin, relay, receiver = Origin(), Relay(), Receiver()
    recorded = []
    for step in (100, 200):
        relay.hear(origin.values(step * PERIOD, b"%d" % step), step * PERIOD)
        recorded.append(relay.say(step * PERIOD))
        receiver.take(recorded[-1], step * PERIOD)
    late_ns = 400 * PERIOD
    assert receiver.take(recorded[0], late_ns) == [], "not after a silence either"
    restarted, relay = Origin(session=SESSION + 1), Relay()
    relay.hear(restarted.values(PERIOD, b"restarted"), PERIOD)
    assert receiver.take(relay.say(PERIOD), late_ns) == [b"restarted"], "its clock began again"
    assert receiver.take(recorded[1], late_ns + PERIOD) == []
    assert receiver.refused == 0, "they were sent once"


def test_values_of_unnamed_node_are_ignored_without_offence() -> None:
    receiver = Receiver()
    unknown = RelayedValue(hardware_id("uav9"), POSE, 5, 0, 2, True, b"value")
    assert receiver.take([unknown], PERIOD) == []
    assert receiver.cache.newest(unknown.origin_hw, POSE) is None
    assert (receiver.refused, receiver.reported()) == (0, [])


def test_unproven_value_is_relayed_after_proof_comes() -> None:
    origin, relay = Origin(), Relay()
    first = origin.values(PERIOD, b"same")
    relay.hear(first, PERIOD, proven=False)
    assert relay.say(PERIOD) == ()
    assert not relay.cache.has_changes(PERIOD, frozenset(), needed)
    relay.hear(first, PERIOD)
    [relayed] = relay.say(PERIOD)
    assert Receiver().take([relayed], PERIOD) == [b"same"]


@pytest.mark.parametrize(("room", "count"), [(0, 0), (60, 0), (150, 0), (230, 1), (500, 6), (1100, 9)])
def test_fewer_values_are_relayed_when_room_is_short(room: int, count: int) -> None:
    origin, relay, receiver = Origin(), Relay(), Receiver()
    relay.hear(origin.values(PERIOD, *(bytes(40) for _ in range(9))), PERIOD)
    relayed = relay.say(PERIOD, room)
    assert len(relayed) == count
    assert all(value.proof is not None for value in relayed)
    assert len(receiver.take(relayed, PERIOD)) == len(relayed)


def test_only_the_newest_signatures_are_remembered() -> None:
    origin, relay = Origin(), Relay()
    checks = checks_of("uav3")
    for step in range(1, REMEMBERED + 10):
        relay.hear(origin.values(step * PERIOD * 4, b"%d" % step), step * PERIOD * 4)
        [value] = relay.say(step * PERIOD * 4)
        assert checks.is_proven(value)
    assert len(checks._valid) == REMEMBERED
