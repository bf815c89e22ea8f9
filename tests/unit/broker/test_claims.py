"""Values that relays state of an origin which is received itself: never used, and counted where false."""

from typing import Final

import pytest

from swarmd.broker.core.beacon.beacon import BoardValue, RelayedValue
from swarmd.broker.core.boards.claims import (
    CLAIMS_MAX,
    HISTORY,
    LEAD_US,
    OVERTAKEN,
    SETTLED_NS,
    OriginBeacon,
    OwnClaims,
)
from swarmd.broker.core.boards.relay_cache import RelayCache, RemoteValue

POSE: Final = 1
ORIGIN, RELAY, FARTHER = 10, 20, 30
STEP_US: Final = 100_000
ALL: Final = (1 << 64) - 1
LATER_NS: Final = SETTLED_NS + 1


class Receiver:
    """A node that receives each beacon of the origin, and what relays state of its board."""

    def __init__(self) -> None:
        self.cache = RelayCache()
        self.sequence = 0

    @property
    def clock_us(self) -> int:
        return self.sequence * STEP_US

    def own(
        self,
        payload: bytes = b"",
        *,
        stamp_us: int | None = None,
        received: int = ALL,
        settled: bool = True,
        skipped: int = 0,
    ) -> RemoteValue | None:
        """The next beacon of the origin, with a value as old as the beacon."""
        self.sequence += 1 + skipped
        age_us = 0 if stamp_us is None else self.clock_us - stamp_us
        value = BoardValue(POSE, age_us, True, payload or b"true %d" % self.sequence)
        beacon = OriginBeacon(self.sequence, received, settled)
        return self.cache.on_own_value(ORIGIN, value, self.clock_us, beacon, self.clock_us * 1000)

    def claim(
        self, stamp_us: int, payload: bytes = b"false", *, relay: int = RELAY, hops: int = 2, age_us: int = 0
    ) -> None:
        value = RelayedValue(ORIGIN, POSE, stamp_us, age_us, hops, True, payload)
        self.cache.on_claim(relay, value, self.sequence, self.clock_us, self.clock_us * 1000)

    @property
    def newest(self) -> bytes:
        value = self.cache.newest(ORIGIN, POSE)
        assert value is not None
        return value.payload

    def contradicted(self) -> list[tuple[int, int]]:
        """Relay and stated hops of the values that count as contradicted since the last call."""
        found, self.cache.contradictions = self.cache.contradictions, []
        assert {(each.origin_hw, each.data_id) for each in found} <= {(ORIGIN, POSE)}
        return [(each.relay_hw, each.hops) for each in found]


@pytest.fixture
def receiver() -> Receiver:
    made = Receiver()
    made.own()
    return made


@pytest.mark.parametrize("ahead_us", [1, 30_000, STEP_US - 1, STEP_US + 1, LEAD_US])
def test_a_false_value_is_never_used_and_counts_when_the_next_beacons_are_there(
    receiver: Receiver, ahead_us: int
) -> None:
    receiver.claim(receiver.clock_us + ahead_us)
    assert receiver.newest == b"true 1"
    found = []
    for _ in range(OVERTAKEN):
        receiver.own()
        found += receiver.contradicted()
    assert found == [(RELAY, 2)]


def test_a_value_of_the_beacon_that_is_still_on_its_way_is_true(receiver: Receiver) -> None:
    receiver.claim(receiver.clock_us + STEP_US, b"true 2", hops=3)
    receiver.claim(receiver.clock_us + STEP_US, b"true 2", relay=FARTHER, hops=3)
    assert receiver.newest == b"true 1"
    assert receiver.own() is not None
    for _ in range(2 * OVERTAKEN):
        receiver.own()
    assert receiver.contradicted() == []


def test_a_relay_that_had_the_next_value_before_is_not_told_again(receiver: Receiver) -> None:
    receiver.claim(receiver.clock_us + STEP_US, b"true 2", hops=3)
    receiver.own()
    asked: list[set[int]] = []

    def needed(_: int, have: set[int]) -> bool:
        asked.append(set(have))
        return False

    receiver.cache.compose(receiver.clock_us * 1000, 1000, frozenset(), needed)
    assert asked == [{ORIGIN, RELAY}]


def test_the_stamp_of_a_true_value_with_another_payload_is_contradicted(receiver: Receiver) -> None:
    receiver.claim(receiver.clock_us + STEP_US)
    receiver.own()
    assert receiver.contradicted() == [(RELAY, 2)]


def test_who_is_always_ahead_is_found_and_each_relay_is_named(receiver: Receiver) -> None:
    found: list[tuple[int, int]] = []
    for _ in range(20):
        receiver.claim(receiver.clock_us + 9 * STEP_US)
        receiver.claim(receiver.clock_us + 9 * STEP_US, relay=FARTHER, hops=5)
        receiver.own()
        found += receiver.contradicted()
    assert set(found) == {(RELAY, 2), (FARTHER, 5)}
    assert len(found) == 2 * (20 // OVERTAKEN)


def test_a_board_that_rests_has_no_later_value(receiver: Receiver) -> None:
    for _ in range(30):
        receiver.claim(receiver.clock_us + 1)
        receiver.own(b"rests", stamp_us=STEP_US + 50_000)
    assert receiver.contradicted()
    assert receiver.newest == b"rests"


def test_a_resting_value_with_the_stamp_of_another_beacon_is_the_same(receiver: Receiver) -> None:
    for late_us in range(0, 100_000, 10_000):
        receiver.own(b"rests", stamp_us=STEP_US + 50_000)
        receiver.claim(STEP_US + 50_000 + late_us, b"rests", age_us=4_000_000)
        receiver.claim(STEP_US + 50_000 + late_us, b"rests", relay=FARTHER, age_us=4_000_000)
    assert receiver.contradicted() == []


def test_nothing_counts_where_a_beacon_is_missing(receiver: Receiver) -> None:
    for missing in range(1, HISTORY):
        receiver.claim(receiver.clock_us + 1)
        receiver.own(received=ALL & ~(1 << missing))
    assert receiver.contradicted() == [], "the value can be that of the missing beacon"
    receiver.claim(receiver.clock_us + 1)
    receiver.own(received=ALL, skipped=64)
    assert receiver.contradicted() == [], "further back than is known"


def test_a_stamp_in_the_future_is_contradicted_at_once_but_not_after_a_restart(receiver: Receiver) -> None:
    receiver.claim(receiver.clock_us + LEAD_US + 1)
    assert receiver.contradicted() == [(RELAY, 2)]
    receiver.own(settled=False)
    receiver.claim(receiver.clock_us + 100 * LEAD_US)
    assert receiver.contradicted() == [], "it can be of the clock before the restart"
    assert receiver.newest == b"true 2"


def test_a_value_that_was_taken_while_the_origin_was_not_received_ends_with_its_next_one() -> None:
    cache = RelayCache()
    assert cache.on_value(RELAY, ORIGIN, POSE, 10**12, 0, 2, True, b"false", 0) is not None
    value = BoardValue(POSE, 0, True, b"true")
    remote = cache.on_own_value(ORIGIN, value, 1000, OriginBeacon(1, 1, False), 1)
    assert remote is not None
    assert (remote.payload, remote.stamp_us) == (b"true", 1000)
    assert cache.newest(ORIGIN, POSE) == remote
    assert cache.on_own_value(ORIGIN, value, 1000, OriginBeacon(2, 3, False), 2) is None, "it is known"


def test_an_overtaken_beacon_replaces_nothing() -> None:
    cache = RelayCache()
    cache.on_value(RELAY, ORIGIN, POSE, 200_000, 0, 2, True, b"newer", 0)
    assert (
        cache.on_own_value(ORIGIN, BoardValue(POSE, 0, True, b"old"), 100_000, OriginBeacon(1, 0, True), 1)
        is None
    )


def test_a_relayed_value_that_is_known_stands_for_a_repetition(receiver: Receiver) -> None:
    receiver.claim(receiver.clock_us, b"true 1", hops=2)
    receiver.claim(receiver.clock_us, b"true 1", hops=2, relay=FARTHER)
    assert receiver.cache.duplicates == 2
    asked: list[set[int]] = []

    def needed(_: int, have: set[int]) -> bool:
        asked.append(have)
        return False

    receiver.cache.compose(receiver.clock_us * 1000, 1000, frozenset(), needed)
    assert {RELAY, FARTHER} <= asked[0], "who has relayed it has it"


def test_relays_without_number_take_no_memory(receiver: Receiver) -> None:
    for relay in range(100, 100 + 10 * CLAIMS_MAX):
        receiver.claim(receiver.clock_us + 1, relay=relay)
    receiver.own()
    assert len(receiver.contradicted()) == CLAIMS_MAX


def test_a_board_that_the_origin_never_sent_is_not_taken_from_a_relay(receiver: Receiver) -> None:
    value = RelayedValue(ORIGIN, POSE + 1, receiver.clock_us, 0, 2, True, b"false")
    receiver.cache.on_claim(RELAY, value, receiver.sequence, receiver.clock_us, 0)
    assert receiver.cache.newest(ORIGIN, POSE + 1) is None


# the origin itself


def stated(stamp_us: int, payload: bytes, data_id: int = POSE) -> RelayedValue:
    return RelayedValue(ORIGIN, data_id, stamp_us, 0, 3, True, payload)


def test_the_origin_knows_all_its_values() -> None:
    own = OwnClaims(ORIGIN)
    assert own.on_claim(RELAY, stated(1, b"x"), 0) is None, "it has sent nothing yet"
    own.on_sent([BoardValue(POSE, 30_050, True, b"true")], 1, 1_000_000_000)
    stamp_us = 1_000_000 - 30_000  # ages are rounded
    assert own.on_claim(RELAY, stated(stamp_us, b"true"), 1_000_000_000) is None
    assert own.on_claim(RELAY, stated(stamp_us + 100_000, b"true"), 1_000_000_000) is None, "rounded again"
    assert own.on_claim(RELAY, stated(stamp_us - 1, b"older"), 1_000_000_000) is None
    assert own.on_claim(RELAY, stated(stamp_us + 1, b"x", POSE + 1), 1_000_000_000) is None
    false = own.on_claim(RELAY, stated(stamp_us + 1, b"false"), 1_000_000_000)
    assert false is not None
    assert (false.relay_hw, false.origin_hw, false.data_id, false.hops) == (RELAY, ORIGIN, POSE, 3)


def test_the_origin_allows_values_of_the_clock_before_its_restart_for_a_while() -> None:
    own = OwnClaims(ORIGIN)
    for tx_ns in (0, LATER_NS):
        own.on_sent([BoardValue(POSE, 0, True, b"true")], 1, tx_ns)
        old = stated((tx_ns // 1000) + 10 * LEAD_US, b"before the restart")
        assert (own.on_claim(RELAY, old, tx_ns) is None) == (tx_ns == 0)
