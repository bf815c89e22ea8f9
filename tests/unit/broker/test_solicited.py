"""A neighbour at rest that is overdue is asked for a beacon; without answers its link is down early."""

from typing import Final

import pytest
from tests.unit.broker.neighbours import AT, ME, MS, SECOND, TIMEOUT, UAV2, UAV3, Peer, bring_up, listed

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header, Hello, PlatformCode
from swarmd.broker.core.beacon.parts.solicitation import (
    ASKED_MAX,
    Solicitation,
    encode_solicitation,
    solicitation_bytes,
)
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.links.solicited import (
    ASKS_MAX,
    ASKS_MIN,
    LOSS_MIN,
    SUSPICION,
    asks,
    overdue_beacons,
)
from swarmd.broker.core.swarm.neighbour import FALSE_ALARM
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.core.swarm.topology import Topology
from swarmware.errors import WireError

ANSWER_NS: Final = 65 * MS
PERIOD_MS: Final = 500
HELLO: Final = Hello(1, 0, 1, 1, 0, PlatformCode.UAV, "uav2", b"", PERIOD_MS)


@pytest.fixture
def table() -> NeighbourTable:
    return NeighbourTable(ME, TIMEOUT)


def at_rest(
    table: NeighbourTable, hw: int = UAV2, *, answer_ns: int = ANSWER_NS, lost: int = 0, period_ms: int = 500
) -> tuple[Peer, int]:
    """A neighbour with a slow rate after 80 beacons, and when the last one arrived; of the last 64 every
    `lost`th is missing."""
    peer = Peer(table, hw)
    peer.period_ms = period_ms
    bring_up(table, peer, 0)
    peer.neighbour.answer_ns = answer_ns
    now_ns = 100 * MS
    for number in range(1, 81):
        now_ns += period_ms * MS
        if lost and number % lost == 0 and number < 80:
            peer.sequence += 1
            continue
        peer.datagram(now_ns, listed(table, now_ns), hello=True)
    assert not table.advance(now_ns)
    return peer, now_ns


def ask_until_down(table: NeighbourTable, peer: Peer, rx_ns: int) -> tuple[list[int], int]:
    """How long after its last beacon each request left, and the link was down; in seconds by 10 ms."""
    asked: list[int] = []
    for now_ns in range(rx_ns, rx_ns + 10 * SECOND, 10 * MS):
        if any(change.after is LinkState.DOWN for change in table.advance(now_ns)):
            return asked, now_ns - rx_ns
        if table.take_asking():
            assert table.asked(now_ns) == (peer.hw,)
            asked.append(now_ns - rx_ns)
    raise AssertionError("never down")


def test_resting_neighbour_is_asked_late_and_lost(
    table: NeighbourTable,
) -> None:
    peer, rx_ns = at_rest(table)
    asked, down_ns = ask_until_down(table, peer, rx_ns)
    assert len(asked) == ASKS_MIN
    assert asked[0] == 630 * MS
    assert TIMEOUT <= down_ns < 1200 * MS


def test_neighbour_without_answer_flag_is_not_asked(table: NeighbourTable) -> None:
    peer, rx_ns = at_rest(table, answer_ns=0)
    deadline_ns = peer.neighbour.deadline_ns - rx_ns
    asked, down_ns = ask_until_down(table, peer, rx_ns)
    assert not asked
    assert down_ns == deadline_ns == 1250 * MS


def test_one_that_answers_late_keeps_its_time(table: NeighbourTable) -> None:
    peer, rx_ns = at_rest(table, answer_ns=SECOND)
    assert ask_until_down(table, peer, rx_ns) == ([], 1250 * MS)


def test_neighbour_at_10_hz_is_not_asked(table: NeighbourTable) -> None:
    peer, rx_ns = at_rest(table, period_ms=100)
    assert ask_until_down(table, peer, rx_ns) == ([], TIMEOUT)


def test_an_answer_ends_the_requests(table: NeighbourTable) -> None:
    peer, rx_ns = at_rest(table)
    now_ns = rx_ns + 630 * MS
    table.advance(now_ns)
    assert table.take_asking()
    assert table.asked(now_ns) == (UAV2,)
    assert not table.take_asking()
    assert table.asked(now_ns) == (), "it has been asked"
    peer.datagram(now_ns + 60 * MS)
    for late_ns in range(0, 620 * MS, 10 * MS):
        assert not table.advance(now_ns + 60 * MS + late_ns)
        assert not table.take_asking()
    assert peer.is_(LinkState.UP)


def test_beacon_before_request_is_not_asked_for(table: NeighbourTable) -> None:
    peer, rx_ns = at_rest(table)
    table.advance(rx_ns + 630 * MS)
    peer.datagram(rx_ns + 640 * MS)
    assert table.asked(rx_ns + 650 * MS) == ()


def test_node_without_requests_ends_no_link_early(table: NeighbourTable) -> None:
    """Requests count when they leave, not when they are due."""
    peer, rx_ns = at_rest(table)
    for now_ns in range(rx_ns, rx_ns + 1240 * MS, 10 * MS):
        assert not table.advance(now_ns)
    assert peer.is_(LinkState.UP)


def test_lossy_link_is_asked_later_and_more_often(
    table: NeighbourTable,
) -> None:
    peer, rx_ns = at_rest(table, lost=3)
    deadline_ns = peer.neighbour.deadline_ns - rx_ns
    asked, down_ns = ask_until_down(table, peer, rx_ns)
    assert asked[0] == 1630 * MS, "after three missing beacons"
    assert ASKS_MIN < len(asked) <= ASKS_MAX
    assert down_ns < deadline_ns - SECOND


def test_the_deadline_is_that_of_the_next_request(table: NeighbourTable) -> None:
    _, rx_ns = at_rest(table)
    assert table.deadline_ns() == rx_ns + 625 * MS
    table.advance(rx_ns + 625 * MS)
    table.asked(rx_ns + 650 * MS)
    assert table.again_ns == rx_ns + 650 * MS + 70 * MS
    table.advance(table.again_ns)
    assert table.take_asking()


def test_a_beacon_asks_a_limited_number_of_neighbours(table: NeighbourTable) -> None:
    rx_ns = max(at_rest(table, 1000 + number)[1] for number in range(ASKED_MAX + 3))
    for hw in range(1000, 1000 + ASKED_MAX + 3):
        neighbour = table.get(hw)
        assert neighbour is not None
        neighbour.ask_due_ns, neighbour.deadline_ns = rx_ns + 1, rx_ns + SECOND
    table.advance(rx_ns + 1)
    assert len(table.asked(rx_ns + 1)) == ASKED_MAX
    assert len(table.asked(rx_ns + 2)) == 3


@pytest.mark.parametrize("neighbours", [1, 2, 15, 100])
@pytest.mark.parametrize("loss", [0.0, 0.01, 0.1, 0.3, 0.6])
def test_vain_requests_are_rare_and_false_alarms_rarer(neighbours: int, loss: float) -> None:
    beacons = overdue_beacons(loss, neighbours)
    assert neighbours * max(loss, LOSS_MIN) ** beacons <= SUSPICION
    known = max(loss, 0.0075)
    needed = asks(known, known, beacons, FALSE_ALARM / neighbours)
    assert ASKS_MIN <= needed <= ASKS_MAX
    false_alarm = known**beacons * (1 - (1 - known) ** 2) ** needed
    assert needed == ASKS_MAX or false_alarm <= FALSE_ALARM / neighbours


def test_one_way_dead_link_is_asked_as_often() -> None:
    assert asks(0.3, 1.0, 3, FALSE_ALARM) == ASKS_MAX


# beacons


def topology() -> Topology:
    return Topology(ME, 1, TIMEOUT, 0)


def test_beacon_states_answer_time_and_asked_neighbours() -> None:
    one = topology()
    header = Header(0, UAV2, 5, 0)
    update = one.on_beacon(header, Beacon(HELLO, solicitation=Solicitation(65, (UAV3, ME))), False, AT, 0)
    assert update is not None
    assert update.is_asked
    assert update.neighbour.answer_ns == ANSWER_NS
    for beacon in (Beacon(solicitation=Solicitation(80, (UAV3,))), Beacon()):
        header.sequence += 1
        update = one.on_beacon(header, beacon, False, AT, MS)
        assert update is not None
        assert not update.is_asked
        assert update.neighbour.answer_ns == 80 * MS, "what it said last"


def test_restarted_neighbour_may_be_of_former_version() -> None:
    one = topology()
    one.on_beacon(Header(0, UAV2, 5, 0), Beacon(HELLO, solicitation=Solicitation(65)), False, AT, 0)
    update = one.on_beacon(Header(0, UAV2, 6, 0), Beacon(HELLO), True, AT, MS)
    assert update is not None
    assert update.neighbour.answer_ns == 0


def test_a_solicitation_survives_its_encoding() -> None:
    for asked in ((), (UAV2,), tuple(range(1, ASKED_MAX + 1))):
        beacon = Beacon(HELLO, solicitation=Solicitation(65, asked))
        body = codec.encode(beacon)
        assert codec.decode(body) == beacon
        assert len(body) - len(codec.encode(Beacon(HELLO))) == solicitation_bytes(len(asked))
    assert codec.decode(codec.encode(Beacon(HELLO))).solicitation is None


@pytest.mark.parametrize("content", [b"", b"\x01", b"\x41\x00\x01\x02\x03"])
def test_solicitation_that_is_cut_short_is_wire_error(content: bytes) -> None:
    body = codec.encode(Beacon(HELLO))
    part = bytes((11,)) + len(content).to_bytes(2, "little") + content
    with pytest.raises(WireError):
        codec.decode(codec.append_statement(body, part))


def test_another_part_before_it_is_skipped() -> None:
    part = bytes((200, 3, 0)) + b"abc" + encode_solicitation(Solicitation(65, (ME,)))
    body = codec.append_statement(codec.encode(Beacon(HELLO)), part)
    assert codec.decode(body).solicitation == Solicitation(65, (ME,))
