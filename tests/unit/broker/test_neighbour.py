"""Neighbours: up and down by deadline, in both directions, with what is measured on the way."""

import random
import sys
from itertools import permutations
from types import FrameType
from typing import Final

import pytest
from tests.unit.broker.neighbours import (
    AT,
    BOOT,
    ME,
    MS,
    SECOND,
    TIMEOUT,
    UAV2,
    UAV3,
    Peer,
    bring_up,
    listed,
)

from swarmd.broker.core.beacon.beacon import NO_ECHO, Echo, Header
from swarmd.broker.core.swarm.links.link import (
    COST_MAX,
    RECEIVED,
    TRANSITIONS,
    LinkChanged,
    LinkEvent,
    LinkState,
)
from swarmd.broker.core.swarm.neighbour import (
    LISTING_NS,
    LISTINGS,
    MEASURED,
    UNLISTED_SLACK_NS,
)
from swarmd.broker.core.swarm.neighbours.neighbour_table import (
    FORGET_NS,
    NEIGHBOUR_LIMIT,
    NeighbourTable,
)

UNLISTED_NS: Final = LISTINGS * LISTING_NS + UNLISTED_SLACK_NS


@pytest.fixture
def table() -> NeighbourTable:
    return NeighbourTable(ME, TIMEOUT)


@pytest.fixture
def peer(table: NeighbourTable) -> Peer:
    return Peer(table)


def test_every_transition_leaves_the_state_it_starts_from() -> None:
    assert all(before is not after for (before, _), after in TRANSITIONS.items())


def test_life_leads_from_unknown_to_forgotten() -> None:
    follows = {
        state: {after for (before, _), after in TRANSITIONS.items() if before is state} for state in LinkState
    }
    assert {before for (before, _), after in TRANSITIONS.items() if after is LinkState.UNKNOWN} == set()
    assert follows[LinkState.FORGOTTEN] == set()
    assert {before for before, after in follows.items() if LinkState.FORGOTTEN in after} == {LinkState.DOWN}
    for state in RECEIVED:
        assert TRANSITIONS[state, LinkEvent.SILENT] is LinkState.DOWN


def test_neighbour_is_received_then_up_when_listing_us(table: NeighbourTable, peer: Peer) -> None:
    peer.datagram(0)
    assert peer.is_(LinkState.HEARD)
    peer.datagram(100 * MS, listed(table, 100 * MS))
    assert peer.is_(LinkState.UP)
    assert [(c.before, c.after) for c in peer.changes] == [
        (LinkState.UNKNOWN, LinkState.HEARD),
        (LinkState.HEARD, LinkState.UP),
    ]


def test_listing_others_does_not_bring_it_up(peer: Peer) -> None:
    peer.datagram(0)
    peer.datagram(100 * MS, Echo(UAV3, 1, 5, 255))
    assert peer.is_(LinkState.HEARD)


def test_listing_without_echo_only_keeps_neighbour_up(table: NeighbourTable, peer: Peer) -> None:
    peer.datagram(0)
    peer.datagram(100 * MS, Echo(ME, 0, NO_ECHO, 255))
    assert peer.is_(LinkState.HEARD), "it may mean our former session"
    peer.datagram(200 * MS, listed(table, 200 * MS))
    now_ns = 200 * MS
    while now_ns < 3 * UNLISTED_NS:
        now_ns += 500 * MS
        peer.datagram(now_ns, Echo(ME, 0, NO_ECHO, 255))
        assert not table.advance(now_ns)
    assert peer.is_(LinkState.UP)


@pytest.mark.parametrize("hold_ms", [200, 5_000])
def test_echo_of_unsent_beacon_does_not_count(table: NeighbourTable, peer: Peer, hold_ms: int) -> None:
    peer.datagram(0)
    table.sent(1, 400 * MS)  # held for longer than it is old: of our former session
    peer.datagram(500 * MS, Echo(ME, 1, hold_ms * 1000, 255))
    peer.datagram(600 * MS, Echo(ME, 2, 0, 255))
    assert peer.is_(LinkState.HEARD)


def test_silence_for_the_timeout_takes_it_down(table: NeighbourTable, peer: Peer) -> None:
    for slot in range(20):
        peer.datagram(slot * 100 * MS, listed(table, slot * 100 * MS), hello=True)
    last_ns = 1900 * MS
    assert table.deadline_ns() == last_ns + TIMEOUT
    assert table.advance(last_ns + TIMEOUT - 1) == []
    [change] = table.advance(last_ns + TIMEOUT)
    assert (change.before, change.after, change.event) == (LinkState.UP, LinkState.DOWN, LinkEvent.SILENT)
    assert table.deadline_ns() is None


def test_slow_sender_without_loss_may_miss_one_datagram(table: NeighbourTable, peer: Peer) -> None:
    peer.period_ms = 500
    for slot in range(20):
        peer.datagram(slot * 500 * MS, listed(table, slot * 500 * MS), hello=True)
    last_ns = 19 * 500 * MS
    assert table.advance(last_ns + 1200 * MS) == []
    assert table.advance(last_ns + 1251 * MS) != []


def test_hello_with_longer_period_defers_deadline_at_once(table: NeighbourTable, peer: Peer) -> None:
    peer.period_ms = 1000
    bring_up(table, peer, 20 * SECOND)
    peer.period_ms = 1500
    peer.datagram(21 * SECOND, hello=True)
    assert table.advance(21 * SECOND + 3500 * MS) == [], "a period and a half after a lost datagram"
    assert peer.is_(LinkState.UP)


def test_declared_period_counts_not_gaps(table: NeighbourTable, peer: Peer) -> None:
    peer.period_ms = 3000
    for slot in range(20):
        peer.datagram(slot * 100 * MS, listed(table, slot * 100 * MS), hello=True)
    assert table.deadline_ns() == 1900 * MS + round(2.5 * 3 * SECOND)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("period_ms", [100, 500])
def test_link_losing_three_of_ten_stays_up(
    table: NeighbourTable, peer: Peer, seed: int, period_ms: int
) -> None:
    chance = random.Random(seed)
    peer.period_ms = period_ms
    bring_up(table, peer, 0)
    peer.changes.clear()
    changes: list[LinkChanged] = []
    for slot in range(1, 600_000 // period_ms):
        now_ns = (100 + slot * period_ms) * MS
        changes += table.advance(now_ns)
        if chance.random() < 0.3:
            peer.sequence += 1
        else:
            peer.datagram(now_ns, *([listed(table, now_ns)] if slot % 4 == 0 else []), hello=slot % 2 == 0)
    falls = [change for change in changes + peer.changes if change.before is LinkState.UP]
    assert len(falls) <= 1, "in ten minutes"


def test_cost_rises_while_a_neighbour_is_silent(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    costs = []
    for silent_ms in (100, 200, 300, 500, 900):
        table.advance((100 + silent_ms) * MS)
        costs.append(peer.neighbour.cost)
    assert costs == sorted(costs)
    assert costs[0] == 256, "the next one may be a little late"
    assert costs[-1] > 400
    peer.datagram(1050 * MS, skip=9)
    assert peer.neighbour.cost < COST_MAX


def test_two_echoes_show_that_neighbour_is_not_received(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    table.advance(10 * SECOND)
    for _ in range(2):
        assert Echo(UAV2, 0, NO_ECHO, 0) in table.echoes(10 * SECOND, 10, LISTING_NS)
    assert table.echoes(10 * SECOND, 10, LISTING_NS) == ()


def test_neighbour_not_receiving_us_is_half_open(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    peer.datagram(200 * MS, Echo(ME, 0, NO_ECHO, 0))
    assert peer.is_(LinkState.HALF_OPEN)
    peer.datagram(300 * MS, listed(table, 300 * MS))
    assert peer.is_(LinkState.UP)


def test_who_lists_us_no_more_is_half_open(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    now_ns = 100 * MS
    while peer.is_(LinkState.UP):
        now_ns += 500 * MS
        peer.datagram(now_ns, Echo(UAV3, 1, 5, 255))
        table.advance(now_ns)
        assert now_ns < 2 * UNLISTED_NS
    assert peer.is_(LinkState.HALF_OPEN)
    assert now_ns > UNLISTED_NS


def test_restart_resets_link_and_its_measurements(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    peer.sequence = 5000
    peer.changes.clear()
    peer.datagram(300 * MS, restarted=True)
    assert peer.is_(LinkState.HEARD)
    assert [c.event for c in peer.changes] == [LinkEvent.RESTARTED]
    assert peer.neighbour.hello is None
    assert peer.neighbour.lost == 0


@pytest.mark.parametrize(
    ("skips", "quality", "lost"), [((0,) * 16, 255, 0), ((1,) * 16, 128, 16), ((3,) * 16, 64, 48)]
)
def test_loss_is_judged_over_the_last_16_datagrams(
    peer: Peer, skips: tuple[int, ...], quality: int, lost: int
) -> None:
    peer.datagram(0)
    for slot, skip in enumerate(skips, start=1):
        peer.datagram(slot * 100 * MS, skip=skip)
    assert abs(peer.neighbour.quality - quality) <= 16
    assert peer.neighbour.lost == lost


def test_overdue_datagrams_are_no_loss_of_the_wire(table: NeighbourTable, peer: Peer) -> None:
    for slot in range(MEASURED):
        peer.datagram(slot * 100 * MS, hello=True)
    table.advance((MEASURED + 4) * 100 * MS)
    assert peer.neighbour.missed == 4
    assert peer.neighbour.quality < 255
    assert peer.neighbour.wire_loss == 0.0
    peer.datagram((MEASURED + 4) * 100 * MS, skip=3)
    assert peer.neighbour.wire_loss == 3 / 16


def test_loss_is_taken_from_two_reports_only(table: NeighbourTable, peer: Peer) -> None:
    def losses(numbers: range, *qualities: int) -> list[float | None]:
        """Loss after each report; own beacons have these numbers."""
        found = []
        for number, quality in zip(numbers, qualities, strict=True):
            table.sent(number, number * 100 * MS)
            peer.datagram(number * 100 * MS + MS, Echo(ME, number, 0, quality))
            found.append(peer.neighbour.wire_loss)
        return found

    assert not any(losses(range(MEASURED), *[32] * MEASURED)), "it has hardly received any"
    assert losses(range(20, 24), 255, 191, 255, 128) == [0.0] * 4
    assert losses(range(24, 25), 128) == [pytest.approx(0.5, abs=0.01)]


def test_a_late_datagram_is_late_and_not_lost(peer: Peer) -> None:
    peer.datagram(0)
    peer.datagram(100 * MS, skip=1)
    assert (peer.neighbour.lost, peer.neighbour.late) == (1, 0)
    peer.sequence = 1
    peer.datagram(110 * MS)
    assert (peer.neighbour.lost, peer.neighbour.late) == (0, 1)


def test_a_jump_of_the_sequence_is_no_loss(peer: Peer) -> None:
    for slot in range(8):
        peer.datagram(slot * 100 * MS)
    peer.datagram(800 * MS, skip=30_000)
    assert peer.neighbour.lost == 0
    assert peer.neighbour.quality == 255


def test_one_datagram_after_silence_proves_nothing(peer: Peer) -> None:
    peer.datagram(0)
    assert peer.neighbour.quality == 32
    for slot in range(1, 8):
        peer.datagram(slot * 100 * MS)
    assert peer.neighbour.quality == 255


@pytest.mark.parametrize("order", list(permutations((1, 2, 3, 4))))
def test_newcomers_first_datagrams_may_come_in_any_order(peer: Peer, order: tuple[int, ...]) -> None:
    for place, sequence in enumerate(order):
        peer.sequence = sequence - 1
        peer.datagram(place * MS)
    assert peer.neighbour.quality == 128, "four of the eight that are expected at least"
    assert peer.neighbour.lost == 0


def test_overtaken_datagrams_never_exceed_perfect_link(table: NeighbourTable, peer: Peer) -> None:
    for sequence in range(40, 0, -1):
        peer.sequence = sequence - 1
        peer.datagram(0)
    assert peer.neighbour.quality == 255
    assert peer.neighbour.lost == 0
    assert table.echoes(0, 10, LISTING_NS)[0].quality == 255


def test_cost_counts_the_loss_of_both_directions(table: NeighbourTable, peer: Peer) -> None:
    bring_up(table, peer, 0)
    assert peer.neighbour.cost == 256
    peer.datagram(200 * MS, listed(table, 200 * MS, quality=128))
    assert peer.neighbour.cost == 1016, "half of them, twice over"


def test_the_offset_is_bounded_from_both_sides(table: NeighbourTable) -> None:
    offset_us = 5_000_000
    peer = Peer(table, offset_us=offset_us)
    peer.datagram(0, hello=True, way_ns=2 * MS)
    table.sent(9, 50 * MS)
    # ours left at 50 ms and took 3 ms; it was held for 45 ms; theirs took 2 ms
    clock_sample = peer.datagram(100 * MS, Echo(ME, 9, 45_000, 255), way_ns=2 * MS)
    assert clock_sample is not None
    assert clock_sample.boot_id == BOOT
    assert clock_sample.reverse_ns == offset_us * 1000 - 2 * MS
    assert clock_sample.forward_ns == offset_us * 1000 + 3 * MS
    assert clock_sample.forward_tx_ns == 50 * MS
    assert peer.neighbour.rtt_ns == 5 * MS


def test_clocks_are_whole_across_wrap_of_32_bits(table: NeighbourTable) -> None:
    offset_us = (3 << 32) - 150_000
    peer = Peer(table, offset_us=offset_us)
    for slot in range(5):
        clock_sample = peer.datagram(slot * 100 * MS, hello=slot == 0)
        assert clock_sample is not None
        assert clock_sample.reverse_ns == offset_us * 1000


def test_a_clock_below_zero_is_whole_too(table: NeighbourTable) -> None:
    peer = Peer(table, offset_us=-5_000_000)
    clock_sample = peer.datagram(100 * MS, hello=True)
    assert clock_sample is not None
    assert clock_sample.reverse_ns == -5 * SECOND


def test_new_neighbours_are_listed_at_once(table: NeighbourTable) -> None:
    peers = [Peer(table, hw) for hw in (UAV2, UAV3, 40)]
    for peer in peers:
        peer.datagram(0)
    assert {echo.hw for echo in table.echoes(0, 10, LISTING_NS)} == {UAV2, UAV3, 40}
    said: list[int] = []
    for slot in range(1, 21):
        for peer in peers:
            peer.datagram(slot * 100 * MS)
        said += [echo.hw for echo in table.echoes(slot * 100 * MS, 10, LISTING_NS)]
    assert {UAV2, UAV3, 40} <= set(said)
    assert len(said) <= 12, "an echo every 0.5 s is enough for a new one"


def test_an_echo_answers_the_datagram_that_came_fastest(table: NeighbourTable, peer: Peer) -> None:
    peer.datagram(0, hello=True)
    table.echoes(0, 10, LISTING_NS)
    for slot, way_ms in enumerate((9, 1, 7), start=1):
        peer.datagram(slot * 100 * MS, way_ns=way_ms * MS)
    [echo] = table.echoes(350 * MS, 10, LISTING_NS)
    assert echo == Echo(UAV2, 3, 150_000, 128)


def test_an_echo_is_said_once(table: NeighbourTable, peer: Peer) -> None:
    peer.datagram(0)
    [first] = table.echoes(0, 10, LISTING_NS)
    [second] = table.echoes(3 * SECOND, 10, LISTING_NS)
    assert first.hold_us != NO_ECHO
    assert second.hold_us == NO_ECHO


def test_longest_waiting_neighbours_are_listed_first(table: NeighbourTable) -> None:
    for index in range(20):
        Peer(table, 100 + index).datagram(0)
    first = {echo.hw for echo in table.echoes(0, 8, LISTING_NS)}
    second = {echo.hw for echo in table.echoes(100 * MS, 8, LISTING_NS)}
    assert len(first) == len(second) == 8
    assert not first & second


def test_many_silent_neighbours_do_not_overfill_datagram(table: NeighbourTable) -> None:
    for index in range(400):
        Peer(table, 100 + index).datagram(0)
    table.advance(20 * SECOND)
    told = [len(table.echoes(20 * SECOND, 30, LISTING_NS)) for _ in range(30)]
    assert max(told) == 30
    assert sum(told) == 400 * 2, "each is told twice"


def test_a_neighbour_that_stays_away_is_forgotten(table: NeighbourTable, peer: Peer) -> None:
    peer.datagram(0)
    table.advance(2 * SECOND)
    neighbour = peer.neighbour
    assert table.advance(FORGET_NS + 2 * SECOND) == [], "no link changes"
    assert table.get(UAV2) is None
    assert neighbour.state is LinkState.FORGOTTEN


def test_neighbours_beyond_the_limit_are_not_taken(table: NeighbourTable) -> None:
    for index in range(NEIGHBOUR_LIMIT):
        Peer(table, 1000 + index).datagram(0)
    header = Header(0, 1, 1, 1)
    assert table.on_header(header, False, AT, 0, []) is None


def test_usual_period_is_the_majoritys(
    table: NeighbourTable,
) -> None:
    peers = [Peer(table, hw) for hw in range(20, 25)]
    for peer, period_ms in zip(peers, (500, 100, 500, 200, 500), strict=True):
        peer.period_ms = period_ms
        peer.datagram(SECOND, hello=True)
    assert table.usual_period_ns() == 500 * MS
    for peer in peers[1::2]:
        peer.datagram(60 * SECOND, hello=True)
    table.advance(60 * SECOND)
    assert table.usual_period_ns() in (100 * MS, 200 * MS)


def test_usual_period_follows_hellos_restarts_and_losses(table: NeighbourTable) -> None:
    assert table.usual_period_ns() == 500 * MS  # of a node that has declared none
    first, second = Peer(table, 20), Peer(table, 21)
    first.datagram(SECOND, hello=True)
    assert table.usual_period_ns() == 100 * MS
    first.period_ms = 250
    first.datagram(2 * SECOND, hello=True)
    assert table.usual_period_ns() == 250 * MS
    second.datagram(2 * SECOND)
    assert table.usual_period_ns() == 500 * MS
    second.datagram(2 * SECOND, hello=True)
    assert table.usual_period_ns() == 250 * MS
    second.datagram(3 * SECOND, restarted=True)
    assert table.usual_period_ns() == 500 * MS
    first.datagram(60 * SECOND)
    table.advance(60 * SECOND)
    assert table.usual_period_ns() == 250 * MS


def test_periods_are_looked_at_again_only_after_change(table: NeighbourTable) -> None:
    peers = [Peer(table, hw) for hw in range(20, 35)]
    for peer in peers:
        peer.datagram(SECOND, hello=True)
    table.usual_period_ns()
    looks = 0

    def count(frame: FrameType, event: str, _argument: object) -> None:
        nonlocal looks
        looks += event == "call" and frame.f_code.co_name == "<genexpr>"

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        for peer in peers:
            peer.datagram(2 * SECOND)
            assert table.usual_period_ns() == 100 * MS
    finally:
        sys.setprofile(before)
    assert looks == 0
