"""A node's side of the beacon: what it says to whom, and what it makes of what others say."""

from itertools import pairwise
from typing import Final

import msgspec
import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import (
    BODY_LIMIT,
    Beacon,
    Header,
    MemberRow,
    OutgoingBeacon,
    PlatformCode,
    RouteRow,
)
from swarmd.broker.core.beacon.beacon_rate import QUIET_HELLOS
from swarmd.broker.core.beacon.hello_schedule import SILENCE_NS, NodeIdentity
from swarmd.broker.core.beacon_protocol import BeaconProtocol, ReceivedBeacon
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.swarm.topology import LinkState, Topology
from swarmd.broker.core.traffic import Counters
from swarmware.model.names import data_id, hardware_id
from swarmware.types.channel import ChannelSettings, SetChannel
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
PERIOD: Final = 100 * MS
POSE: Final = data_id("nav/pose", "Pose")
OFFER: Final = BoardPublication("nav/pose", POSE, "Pose")


def is_up(node: "Node", other: "Node") -> bool:
    neighbour = node.protocol.topology.neighbours.get(other.hw)
    return neighbour is not None and neighbour.state is LinkState.UP


class Node:
    """A beacon protocol whose datagrams go straight to another one."""

    def __init__(self, name: str, *, session: int = 1, clock_us: int = 0, boot_id: int = 1) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.session = session
        self.clock_ns = clock_us * 1000
        """Clock of the node minus the test's."""
        self.counters = Counters()
        self.protocol = BeaconProtocol(
            NodeIdentity(self.hw, name, "main", PlatformCode.UAV, boot_id, b""),
            Topology(self.hw, 100 * session, SECOND, -(1 << 62)),
            self.counters,
            Config(relay_bytes_s=3000.0),
        )

    def compose(self, now_ns: int) -> OutgoingBeacon:
        self.newest = self.protocol.compose(now_ns + self.clock_ns)
        return self.newest

    def transmit(self, now_ns: int, *others: "Node") -> list[ReceivedBeacon]:
        """One beacon, encoded and decoded as on the wire."""
        clock_ns = now_ns + self.clock_ns
        outgoing = self.compose(now_ns)
        body = codec.encode(outgoing.beacon)
        assert len(body) <= BODY_LIMIT
        self.protocol.sent(outgoing.sequence, clock_ns, len(body) + 38)
        session = self.session if outgoing.with_session else None
        header = Header(0, self.hw, outgoing.sequence, clock_ns // 1000 & 0xFFFF_FFFF, session)
        arrivals = [
            other.protocol.on_beacon(header, codec.decode(body), ("h", 1), now_ns + other.clock_ns)
            for other in others
        ]
        return [received for received in arrivals if received is not None]

    def put(self, payload: bytes, now_ns: int) -> None:
        self.protocol.published.boards[POSE].put(payload, True, now_ns + self.clock_ns)


def meet(*nodes: Node, now_ns: int = 0) -> None:
    """Three rounds of beacons, after which all links are up."""
    for round_ns in range(now_ns, now_ns + 3 * PERIOD, PERIOD):
        for node in nodes:
            node.protocol.advance(round_ns + node.clock_ns)
            node.transmit(round_ns, *(other for other in nodes if other is not node))
    for node in nodes:
        assert all(n.state is LinkState.UP for n in node.protocol.topology.neighbours.all())


@pytest.fixture
def one() -> Node:
    return Node("uav1")


@pytest.fixture
def other() -> Node:
    return Node("uav2", clock_us=5_000_000)


def test_the_first_datagram_says_name_and_session(one: Node, other: Node) -> None:
    outgoing = one.compose(0)
    assert outgoing.with_session
    assert outgoing.beacon.hello is not None
    assert outgoing.beacon.hello.name == "uav1"
    assert not one.compose(PERIOD).with_session
    assert not one.compose(SECOND).with_session
    assert one.compose(2 * SECOND).with_session


def test_names_are_repeated_sooner_after_link_changes(one: Node, other: Node) -> None:
    def hellos(start_ns: int) -> list[int]:
        times_ns = range(start_ns, start_ns + 5 * SECOND, PERIOD)
        return [at_ns - start_ns for at_ns in times_ns if one.compose(at_ns).with_session]

    assert hellos(0) == [0, 2 * SECOND, 4 * SECOND]
    one.protocol.advance(6 * SECOND)
    one.protocol.set_plan(TreePlan(9))
    assert hellos(6 * SECOND) == [0, SECOND, 3 * SECOND]
    meet(one, other, now_ns=20 * SECOND)
    assert len(hellos(21 * SECOND)) >= 4, "a link came up"


def test_first_hello_of_neighbour_is_reported_once(one: Node, other: Node) -> None:
    assert [received.first_hello for received in one.transmit(0, other)] == [True]
    one.protocol.hellos.schedule()
    assert [received.first_hello for received in one.transmit(PERIOD, other)] == [False]


def test_three_datagrams_bring_two_nodes_together(one: Node, other: Node) -> None:
    one.transmit(0, other)
    other.transmit(10 * MS, one)
    one.transmit(60 * MS, other)
    assert is_up(one, other)
    assert is_up(other, one)
    assert one.protocol.topology.routing.next_hop(other.hw) == other.hw


def test_name_that_contradicts_number_is_refused(one: Node, other: Node) -> None:
    one.hw += 1
    assert one.transmit(0, other) == []
    assert other.counters.refused.malformed == 1


def test_subscribed_value_arrives_with_stamp_of_its_clock(one: Node, other: Node) -> None:
    meet(one, other)
    other.protocol.set_plan(TreePlan(1, offers=(OFFER,)))
    one.protocol.set_plan(TreePlan(1, wants=(want := BoardSubscription("uav2", "nav/pose", "Pose", POSE),)))
    other.put(b"here", 450 * MS)
    [received] = other.transmit(500 * MS, one)
    [(wanted, value)] = received.values
    assert wanted == want
    assert value == RemoteValue(other.hw, POSE, 5_450_000, 50_000, True, b"here", 500 * MS)
    assert one.counters.channel("nav/pose").received_frames == 1
    assert other.counters.channel("nav/pose").sent_frames == 1


def test_value_is_delivered_from_cache_when_subscription_begins(one: Node, other: Node) -> None:
    meet(one, other)
    other.protocol.set_plan(TreePlan(1, offers=(OFFER,)))
    other.put(b"here", 450 * MS)
    [received] = other.transmit(500 * MS, one)
    assert received.values == []
    heard, _ = one.protocol.set_plan(
        TreePlan(1, wants=(BoardSubscription("uav2", "nav/pose", "Pose", POSE),))
    )
    assert [value.payload for _, value in heard] == [b"here"]


def test_a_node_without_subscribers_sends_beacons_slowly(one: Node) -> None:
    assert one.protocol.beacon_hz() == 2.0
    one.protocol.set_plan(TreePlan(1, offers=(OFFER,)))
    assert one.protocol.beacon_hz() == 10.0
    one.protocol.set_plan(TreePlan(1))
    assert one.protocol.beacon_hz() == 2.0


def test_idle_node_sends_faster_during_link_changes(one: Node, other: Node) -> None:
    assert one.protocol.beacon_hz() == 2.0
    meet(one, other)
    assert one.protocol.beacon_hz() == 5.0
    for slot in range(3, 60):
        other.transmit(slot * PERIOD, one)
        one.protocol.advance(slot * PERIOD)
    for slot in range(60, 60 + QUIET_HELLOS):
        assert one.protocol.beacon_hz() == 5.0, "its neighbours may not know the longer period yet"
        hello = one.protocol.compose(slot * PERIOD).beacon.hello
        assert hello is not None
        assert hello.period_ms == 500
    assert one.protocol.beacon_hz() == 2.0
    one.protocol.advance(10 * SECOND)
    assert not is_up(one, other)
    assert one.protocol.beacon_hz() == 5.0


def test_hello_says_how_long_next_datagrams_may_take(one: Node, other: Node) -> None:
    meet(one, other)
    [neighbour] = other.protocol.topology.neighbours.all()
    assert neighbour.period_ns == 500 * MS
    for slot in range(3, 90):
        other.transmit(slot * PERIOD, one)
        one.protocol.advance(slot * PERIOD)
    outgoing = one.compose(9 * SECOND)
    assert outgoing.beacon.hello is not None
    assert outgoing.beacon.hello.period_ms == 500
    one.protocol.sent(outgoing.sequence, 9 * SECOND, 100)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    assert one.compose(9 * SECOND + PERIOD).beacon.hello is None, "sooner than declared harms nobody"
    one.protocol.set_plan(TreePlan(0))


def test_restarted_node_names_its_session_in_beacons() -> None:
    again = Node("uav1", session=2)
    again.protocol.topology = Topology(again.hw, 200, SECOND, quiet_until_ns=2 * SECOND)
    again.protocol.advance(0)
    assert again.protocol.beacon_hz() == 10.0
    assert all(again.compose(slot * PERIOD).with_session for slot in range(15))
    again.protocol.advance(2 * SECOND)
    assert again.protocol.beacon_hz() == 2.0
    again.compose(2 * SECOND)
    assert not again.compose(2 * SECOND + PERIOD).with_session


def told(node: Node, other: Node, beacons: range, payload: bytes | None = None) -> list[tuple[int, Beacon]]:
    """The datagrams of some slots; with a payload the board is written before each of them."""
    found = []
    for beacon in beacons:
        now_ns = beacon * PERIOD
        if payload is not None:
            node.put(payload, now_ns)
        if not node.protocol.may_skip(now_ns):
            found.append((now_ns, node.compose(now_ns).beacon))
            node.transmit(now_ns, other)
    return found


def test_no_beacon_is_skipped_while_clock_is_new(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    one.put(b"parked", 0)
    assert len(told(one, other, range(4, 140))) == 136


def test_boards_that_do_not_change_need_no_beacon(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    one.put(b"parked", 203 * PERIOD)
    at = [now_ns for now_ns, _ in told(one, other, range(204, 244))]
    assert max(after - before for before, after in pairwise(at)) < SILENCE_NS + PERIOD
    assert len(at) <= 11
    one.put(b"moving", 244 * PERIOD)
    assert not one.protocol.may_skip(244 * PERIOD)


def test_unchanged_board_needs_no_beacon_but_newest_stamp(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    told(one, other, range(204, 210), b"parked")
    quiet = told(one, other, range(210, 260), b"parked")
    assert len(quiet) <= 11, "of 50 slots"
    assert all(beacon.values[0].age_us == 0 for _, beacon in quiet)


def test_changed_value_is_sent_in_three_beacons(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    told(one, other, range(204, 221), b"parked")
    at = [now_ns // PERIOD for now_ns, _ in told(one, other, range(221, 228), b"moved")]
    assert at[:3] == [221, 222, 223]
    assert at[3:] == []


def test_board_of_slow_rate_waits_for_next_beacon(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(msgspec.structs.replace(OFFER, min_interval_ms=1000),)))
    told(one, other, range(204, 220))
    one.put(b"99 %", 220 * PERIOD)
    at = [now_ns // PERIOD for now_ns, beacon in told(one, other, range(220, 226)) if beacon.values]
    assert len(at) == 1


def test_resting_node_sends_new_mission_at_once(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    [*_, (last_ns, _)] = told(one, other, range(204, 230), b"parked")
    assert one.protocol.may_skip(last_ns + PERIOD)
    one.protocol.set_plan(TreePlan(0, offers=(OFFER,), mission=7))
    assert not one.protocol.may_skip(last_ns + PERIOD)


def test_resting_relay_is_quiet_and_passes_changes() -> None:
    left, middle, right = Node("uav1"), Node("uav2"), Node("uav3")
    left.protocol.set_plan(TreePlan(0, offers=(OFFER,)))
    right.protocol.set_plan(TreePlan(0, wants=(BoardSubscription("uav1", "nav/pose", "Pose", POSE),)))
    sent, arrived = [], []
    for slot in range(250):
        now_ns = slot * PERIOD
        left.put(b"parked" if slot < 240 else b"moved!", now_ns)
        for node, others in ((left, (middle,)), (middle, (left, right)), (right, (middle,))):
            node.protocol.advance(now_ns)
            if node.protocol.may_skip(now_ns):
                continue
            arrivals = node.transmit(now_ns, *others)
            if node is middle:
                sent.append(slot)
                arrived += [
                    (slot, value.payload) for received in arrivals for _, value in received.values if received
                ]
    assert middle.protocol.busy
    assert len([slot for slot in sent if 190 <= slot < 240]) <= 12, "of 50 slots"
    assert arrived[-1][1] == b"moved!"
    assert min(slot for slot, payload in arrived if payload == b"moved!") <= 241
    assert max(b - a for (a, _), (b, _) in pairwise(arrived[-12:])) <= 8, "its age stays young"


def test_limit_of_channel_holds_from_next_beacon(one: Node, other: Node) -> None:
    one.protocol.set_plan(TreePlan(1, offers=(OFFER,)))
    one.put(b"x", 0)
    one.protocol.channels.set(SetChannel("nav/*", ChannelSettings(0.0)), 0)
    one.protocol.advance(0)
    assert one.compose(0).beacon.values == ()
    one.protocol.channels.set(SetChannel("nav/*"), 0)
    one.protocol.advance(PERIOD)
    assert len(one.compose(PERIOD).beacon.values) == 1


def test_a_new_tree_is_told_at_once(one: Node, other: Node) -> None:
    meet(one, other)
    one.protocol.set_plan(TreePlan(77))
    one.transmit(400 * MS, other)
    member = other.protocol.nodes.get(one.hw)
    assert member is not None
    assert member.tree_version == 77


def test_names_and_trees_go_over_the_next_hop(one: Node, other: Node) -> None:
    far = Node("uav3")
    meet(one, other)
    meet(other, far, now_ns=PERIOD * 3)
    one.protocol.set_plan(TreePlan(5))
    now_ns = 6 * PERIOD
    for _ in range(4):
        now_ns += PERIOD
        one.transmit(now_ns, other)
        other.transmit(now_ns, one, far)
        far.transmit(now_ns, other)
    member = far.protocol.nodes.get(one.hw)
    assert member is not None
    assert (member.platform, member.tree_version) == ("uav1", 5)
    assert far.protocol.topology.routing.next_hop(one.hw) == other.hw


def test_names_are_repeated_for_unconnected_new_neighbour(one: Node, other: Node) -> None:
    relay, far, first, new = Node("uav3"), Node("uav4"), Node("uav5"), Node("uav6")
    meet(relay, far)
    for at_ns in range(400 * MS, 1200 * MS, PERIOD):  # a line: far, relay, one, and other next to the relay
        for node, near in ((far, (relay,)), (relay, (far, one, other)), (one, (relay,)), (other, (relay,))):
            node.protocol.advance(at_ns + node.clock_ns)
            node.transmit(at_ns, *near)
    assert one.protocol.topology.routing.next_hop(other.hw) == relay.hw

    def repeated(neighbour: Node, from_ns: int) -> set[str]:
        names = set[str]()
        for at_ns in range(from_ns, from_ns + 4 * PERIOD, PERIOD):
            neighbour.transmit(at_ns, one)
            one.transmit(at_ns, neighbour)
            names |= {row.name for row in one.newest.beacon.members}
        assert is_up(one, neighbour)
        return names

    assert repeated(first, 1200 * MS) >= {"uav4"}
    assert repeated(other, 1600 * MS) == set()
    assert repeated(new, 2000 * MS) >= {"uav4"}


def test_node_beside_route_changes_no_tree(one: Node, other: Node) -> None:
    meet(one, other)
    row = MemberRow(other.hw, 99, PlatformCode.UAV, "uav2")
    liar = hardware_id("uav9")
    one.protocol.on_beacon(Header(0, liar, 1, 0, 1), Beacon(members=(row,)), ("h", 2), 400 * MS)
    member = one.protocol.nodes.get(other.hw)
    assert member is not None
    assert member.tree_version != 99


def test_boards_are_relayed_where_origin_is_not_received(one: Node, other: Node) -> None:
    far = Node("uav3")
    meet(one, other)
    meet(other, far, now_ns=3 * PERIOD)
    one.protocol.set_plan(TreePlan(1, offers=(OFFER,)))
    far.protocol.set_plan(TreePlan(1, wants=(BoardSubscription("uav1", "nav/pose", "Pose", POSE),)))
    one.put(b"here", 600 * MS)
    one.transmit(600 * MS, other)
    assert other.protocol.beacon_hz() < 10.0
    [_, received] = other.transmit(700 * MS, one, far)
    [(_, value)] = received.values
    assert (value.payload, value.origin_hw, value.stamp_us, value.age_us) == (
        b"here",
        one.hw,
        600_000,
        100_000,
    )
    assert other.protocol.beacon_hz() == 10.0, "somebody depends on it now"


def test_a_restarted_neighbour_is_met_anew(one: Node, other: Node) -> None:
    meet(one, other)
    again = Node("uav2", session=2)
    [received] = again.transmit(400 * MS, one)
    assert received.first_hello
    assert [change.after for change in received.links] == [LinkState.HEARD]
    assert one.protocol.topology.routing.next_hop(other.hw) == 0
    meet(one, again, now_ns=500 * MS)
    assert one.protocol.topology.routing.next_hop(other.hw) == other.hw


def test_body_stays_within_its_limit(one: Node, other: Node) -> None:
    meet(one, other)
    offers = tuple(BoardPublication(f"a/b{index}", index + 1, "Float") for index in range(200))
    one.protocol.set_plan(TreePlan(1, offers=offers))
    for board in one.protocol.published.boards.values():
        board.put(bytes(40), False, 0)
    rows = tuple(RouteRow(1000 + index, 1, 256) for index in range(250))
    header = Header(0, other.hw, 1000, 0)
    one.protocol.on_beacon(header, Beacon(rows=rows), ("h", 1), 400 * MS)
    sent: set[int] = set()
    for slot in range(4, 40):
        outgoing = one.compose(slot * PERIOD)
        assert len(codec.encode(outgoing.beacon)) <= BODY_LIMIT
        sent |= {value.data_id for value in outgoing.beacon.values}
    assert len(sent) == 200


def test_unused_relay_budget_is_left_to_next_beacon(one: Node, other: Node) -> None:
    meet(one, other)
    start_ns, relays = 10 * PERIOD, 0
    one.transmit(start_ns, other)
    for slot in range(1, 24):
        now_ns = start_ns + slot * PERIOD
        for origin in range(100, 105):
            value = b"%0200d" % slot
            one.protocol.relay_cache.on_value(origin, origin, POSE, now_ns // 1000, 0, 1, True, value, now_ns)
        one.transmit(now_ns, other)
        relays += len(one.newest.beacon.relays) if slot > 3 else 0
    sent_bytes_s = relays * codec.relay_bytes(bytes(200)) / 2.0
    assert sent_bytes_s == pytest.approx(3000.0, rel=0.1), "two of 220 bytes do not fit into 300"
