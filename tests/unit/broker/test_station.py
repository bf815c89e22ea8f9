"""A node's side of the tick: what it says to whom, and what it makes of what others say."""

from itertools import pairwise
from typing import Final

import msgspec
import pytest

from swarmd.broker.core import tick as codec
from swarmd.broker.core.mesh import LinkState, Mesh
from swarmd.broker.core.relay import News
from swarmd.broker.core.station import SILENCE_NS, Arrival, Departure, Identity, Station
from swarmd.broker.core.tick import BODY_LIMIT, Header, PlatformKind, Row, Tick
from swarmd.broker.core.traffic import Counters
from swarmware.names import data_id, hardware_id
from swarmware.types.net import Offer, SetChannel, TreePlan, Want

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
TICK: Final = 100 * MS
POSE: Final = data_id("nav/pose", "Pose")
OFFER: Final = Offer("nav/pose", POSE, "Pose")


class Node:
    """A station whose datagrams go straight to another one."""

    def __init__(self, name: str, *, session: int = 1, clock_us: int = 0, boot_id: int = 1) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.session = session
        self.clock_ns = clock_us * 1000
        """Its clock minus the test's."""
        self.counters = Counters()
        self.station = Station(
            Identity(self.hw, name, "main", PlatformKind.UAV, boot_id, b""),
            Mesh(self.hw, 100 * session, SECOND, -(1 << 62)),
            self.counters,
            busy_hz=10.0,
            relay_bytes_s=3000.0,
        )

    def compose(self, now_ns: int) -> Departure:
        return self.station.compose(now_ns + self.clock_ns)

    def tell(self, now_ns: int, *others: "Node") -> list[Arrival]:
        """One tick, encoded and decoded as on the wire."""
        clock_ns = now_ns + self.clock_ns
        departure = self.compose(now_ns)
        body = codec.encode(departure.tick)
        assert len(body) <= BODY_LIMIT
        self.station.sent(departure.sequence, clock_ns, len(body) + 38)
        session = self.session if departure.with_session else None
        header = Header(0, self.hw, departure.sequence, clock_ns // 1000 & 0xFFFF_FFFF, session)
        arrivals = [
            other.station.on_datagram(header, codec.decode(body), ("h", 1), now_ns + other.clock_ns)
            for other in others
        ]
        return [arrival for arrival in arrivals if arrival is not None]

    def put(self, payload: bytes, now_ns: int) -> None:
        self.station.bulletin.boards[POSE].put(payload, True, now_ns + self.clock_ns)


def meet(*nodes: Node, now_ns: int = 0) -> None:
    """Three rounds of ticks: everybody is up with everybody."""
    for round_ns in range(now_ns, now_ns + 3 * TICK, TICK):
        for node in nodes:
            node.station.on_timer(round_ns + node.clock_ns)
            node.tell(round_ns, *(other for other in nodes if other is not node))
    for node in nodes:
        assert all(n.state is LinkState.UP for n in node.station.mesh.neighbours.all())


@pytest.fixture
def one() -> Node:
    return Node("uav1")


@pytest.fixture
def other() -> Node:
    return Node("uav2", clock_us=5_000_000)


def test_the_first_datagram_says_name_and_session(one: Node, other: Node) -> None:
    departure = one.compose(0)
    assert departure.with_session
    assert departure.tick.hello is not None
    assert departure.tick.hello.name == "uav1"
    assert not one.compose(TICK).with_session
    assert not one.compose(SECOND).with_session
    assert one.compose(2 * SECOND).with_session


def test_names_are_repeated_sooner_while_links_change_and_after_a_new_tree(one: Node, other: Node) -> None:
    def hellos(start_ns: int) -> list[int]:
        times_ns = range(start_ns, start_ns + 5 * SECOND, TICK)
        return [at_ns - start_ns for at_ns in times_ns if one.compose(at_ns).with_session]

    assert hellos(0) == [0, 2 * SECOND, 4 * SECOND]
    one.station.on_timer(6 * SECOND)
    one.station.set_plan(TreePlan(9))
    assert hellos(6 * SECOND) == [0, SECOND, 3 * SECOND]
    meet(one, other, now_ns=20 * SECOND)
    assert len(hellos(21 * SECOND)) >= 4, "a link came up"


def test_a_newcomer_is_a_stranger_once(one: Node, other: Node) -> None:
    assert [arrival.stranger for arrival in one.tell(0, other)] == [True]
    one.station.say_hello()
    assert [arrival.stranger for arrival in one.tell(TICK, other)] == [False]


def test_three_datagrams_bring_two_nodes_together(one: Node, other: Node) -> None:
    one.tell(0, other)
    other.tell(10 * MS, one)
    one.tell(60 * MS, other)
    assert one.station.is_up(other.hw)
    assert other.station.is_up(one.hw)
    assert one.station.next_hop(other.hw) == other.hw


def test_who_has_another_name_than_its_number_is_refused(one: Node, other: Node) -> None:
    one.hw += 1
    assert one.tell(0, other) == []
    assert other.counters.refused.malformed == 1


def test_a_wanted_value_is_news_with_the_stamp_of_its_clock(one: Node, other: Node) -> None:
    meet(one, other)
    other.station.set_plan(TreePlan(1, offers=(OFFER,)))
    one.station.set_plan(TreePlan(1, wants=(want := Want("uav2", "nav/pose", "Pose", POSE),)))
    other.put(b"here", 450 * MS)
    [arrival] = other.tell(500 * MS, one)
    [(wanted, news)] = arrival.news
    assert wanted == want
    assert news == News(other.hw, POSE, 5_450_000, 50_000, True, b"here", 500 * MS)
    assert one.counters.channel("nav/pose").received_frames == 1
    assert other.counters.channel("nav/pose").sent_frames == 1


def test_a_value_that_nobody_here_reads_is_no_news_until_somebody_does(one: Node, other: Node) -> None:
    meet(one, other)
    other.station.set_plan(TreePlan(1, offers=(OFFER,)))
    other.put(b"here", 450 * MS)
    [arrival] = other.tell(500 * MS, one)
    assert arrival.news == []
    heard = one.station.set_plan(TreePlan(1, wants=(Want("uav2", "nav/pose", "Pose", POSE),)))
    assert [news.payload for _, news in heard] == [b"here"]


def test_a_node_of_which_nobody_wants_anything_ticks_slowly(one: Node) -> None:
    assert one.station.tick_hz() == 2.0
    one.station.set_plan(TreePlan(1, offers=(OFFER,)))
    assert one.station.tick_hz() == 10.0
    one.station.set_plan(TreePlan(1))
    assert one.station.tick_hz() == 2.0


def test_an_idle_node_ticks_faster_while_its_links_come_and_go(one: Node, other: Node) -> None:
    assert one.station.tick_hz() == 2.0
    meet(one, other)
    assert one.station.tick_hz() == 5.0
    for tick in range(3, 60):
        other.tell(tick * TICK, one)
        one.station.on_timer(tick * TICK)
    assert one.station.tick_hz() == 2.0
    one.station.on_timer(10 * SECOND)
    assert not one.station.is_up(other.hw)
    assert one.station.tick_hz() == 5.0


def test_a_hello_says_how_long_the_next_datagrams_may_take(one: Node, other: Node) -> None:
    meet(one, other)
    [neighbour] = other.station.mesh.neighbours.all()
    assert neighbour.period_ns == 500 * MS
    for tick in range(3, 90):
        other.tell(tick * TICK, one)
        one.station.on_timer(tick * TICK)
    departure = one.compose(9 * SECOND)
    assert departure.tick.hello is not None
    assert departure.tick.hello.period_ms == 500
    one.station.sent(departure.sequence, 9 * SECOND, 100)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    assert one.compose(9 * SECOND + TICK).tick.hello is None, "sooner than declared harms nobody"
    one.station.set_plan(TreePlan(0))


def test_a_node_that_started_anew_says_its_session_with_each_of_ten_ticks_a_second() -> None:
    again = Node("uav1", session=2)
    again.station.mesh = Mesh(again.hw, 200, SECOND, quiet_until_ns=2 * SECOND)
    again.station.on_timer(0)
    assert again.station.tick_hz() == 10.0
    assert all(again.compose(tick * TICK).with_session for tick in range(15))
    again.station.on_timer(2 * SECOND)
    assert again.station.tick_hz() == 2.0
    again.compose(2 * SECOND)
    assert not again.compose(2 * SECOND + TICK).with_session


def told(node: Node, other: Node, ticks: range, payload: bytes | None = None) -> list[tuple[int, Tick]]:
    """The datagrams of some slots; with a payload the board is written before each of them."""
    found = []
    for tick in ticks:
        now_ns = tick * TICK
        if payload is not None:
            node.put(payload, now_ns)
        if not node.station.is_idle(now_ns):
            found.append((now_ns, node.compose(now_ns).tick))
            node.tell(now_ns, other)
    return found


def test_no_tick_is_left_out_while_a_clock_is_new(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    one.put(b"parked", 0)
    assert len(told(one, other, range(4, 140))) == 136


def test_boards_that_stand_still_need_no_tick(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    one.put(b"parked", 203 * TICK)
    at = [now_ns for now_ns, _ in told(one, other, range(204, 244))]
    assert max(after - before for before, after in pairwise(at)) < SILENCE_NS + TICK
    assert len(at) <= 11
    one.put(b"moving", 244 * TICK)
    assert not one.station.is_idle(244 * TICK)


def test_a_board_that_is_written_again_with_the_same_value_needs_no_tick_but_its_newest_stamp_is_told(
    one: Node, other: Node
) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    told(one, other, range(204, 210), b"parked")
    quiet = told(one, other, range(210, 260), b"parked")
    assert len(quiet) <= 11, "of 50 slots"
    assert all(tick.values[0].age_us == 0 for _, tick in quiet)


def test_a_change_that_is_written_again_is_told_in_three_ticks_in_a_row(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    told(one, other, range(204, 221), b"parked")
    at = [now_ns // TICK for now_ns, _ in told(one, other, range(221, 228), b"moved")]
    assert at[:3] == [221, 222, 223]
    assert at[3:] == []


def test_a_board_of_a_slow_rate_waits_for_the_next_tick(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(msgspec.structs.replace(OFFER, min_interval_ms=1000),)))
    told(one, other, range(204, 220))
    one.put(b"99 %", 220 * TICK)
    at = [now_ns // TICK for now_ns, tick in told(one, other, range(220, 226)) if tick.values]
    assert len(at) == 1


def test_a_new_mission_is_said_at_once_by_a_node_at_rest(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(0, offers=(OFFER,)))
    [*_, (last_ns, _)] = told(one, other, range(204, 230), b"parked")
    assert one.station.is_idle(last_ns + TICK)
    one.station.set_plan(TreePlan(0, offers=(OFFER,), mission=7))
    assert not one.station.is_idle(last_ns + TICK)


def test_who_passes_on_boards_at_rest_is_quiet_and_passes_on_a_change_at_once() -> None:
    left, middle, right = Node("uav1"), Node("uav2"), Node("uav3")
    left.station.set_plan(TreePlan(0, offers=(OFFER,)))
    right.station.set_plan(TreePlan(0, wants=(Want("uav1", "nav/pose", "Pose", POSE),)))
    sent, arrived = [], []
    for tick in range(250):
        now_ns = tick * TICK
        left.put(b"parked" if tick < 240 else b"moved!", now_ns)
        for node, others in ((left, (middle,)), (middle, (left, right)), (right, (middle,))):
            node.station.on_timer(now_ns)
            if node.station.is_idle(now_ns):
                continue
            arrivals = node.tell(now_ns, *others)
            if node is middle:
                sent.append(tick)
                arrived += [
                    (tick, news.payload) for arrival in arrivals for _, news in arrival.news if arrival
                ]
    assert middle.station.busy
    assert len([tick for tick in sent if 190 <= tick < 240]) <= 12, "of 50 slots"
    assert arrived[-1][1] == b"moved!"
    assert min(tick for tick, payload in arrived if payload == b"moved!") <= 241
    assert max(b - a for (a, _), (b, _) in pairwise(arrived[-12:])) <= 8, "its age stays young"


def test_a_limit_of_a_channel_holds_from_the_next_tick(one: Node, other: Node) -> None:
    one.station.set_plan(TreePlan(1, offers=(OFFER,)))
    one.put(b"x", 0)
    one.station.channels.set(SetChannel("nav/*", 0.0), 0)
    one.station.on_timer(0)
    assert one.compose(0).tick.values == ()
    one.station.channels.set(SetChannel("nav/*"), 0)
    one.station.on_timer(TICK)
    assert len(one.compose(TICK).tick.values) == 1


def test_a_new_tree_is_told_at_once(one: Node, other: Node) -> None:
    meet(one, other)
    one.station.set_plan(TreePlan(77))
    one.tell(400 * MS, other)
    member = other.station.members.get(one.hw)
    assert member is not None
    assert member.tree_version == 77


def test_names_and_trees_go_over_the_next_hop(one: Node, other: Node) -> None:
    far = Node("uav3")
    meet(one, other)
    meet(other, far, now_ns=TICK * 3)
    one.station.set_plan(TreePlan(5))
    now_ns = 6 * TICK
    for _ in range(4):
        now_ns += TICK
        one.tell(now_ns, other)
        other.tell(now_ns, one, far)
        far.tell(now_ns, other)
    member = far.station.members.get(one.hw)
    assert member is not None
    assert (member.platform, member.tree_version) == ("uav1", 5)
    assert far.station.next_hop(one.hw) == other.hw


def test_who_is_not_the_next_hop_changes_no_tree(one: Node, other: Node) -> None:
    meet(one, other)
    row = codec.MemberRow(other.hw, 99, PlatformKind.UAV, "uav2")
    liar = hardware_id("uav9")
    one.station.on_datagram(Header(0, liar, 1, 0, 1), Tick(members=(row,)), ("h", 2), 400 * MS)
    member = one.station.members.get(other.hw)
    assert member is not None
    assert member.tree_version != 99


def test_boards_are_passed_on_to_those_who_do_not_hear_their_origin(one: Node, other: Node) -> None:
    far = Node("uav3")
    meet(one, other)
    meet(other, far, now_ns=3 * TICK)
    one.station.set_plan(TreePlan(1, offers=(OFFER,)))
    far.station.set_plan(TreePlan(1, wants=(Want("uav1", "nav/pose", "Pose", POSE),)))
    one.put(b"here", 600 * MS)
    one.tell(600 * MS, other)
    assert other.station.tick_hz() < 10.0
    [_, arrival] = other.tell(700 * MS, one, far)
    [(_, news)] = arrival.news
    assert (news.payload, news.origin_hw, news.stamp_us, news.age_us) == (b"here", one.hw, 600_000, 100_000)
    assert other.station.tick_hz() == 10.0, "somebody depends on it now"


def test_a_restarted_neighbour_is_met_anew(one: Node, other: Node) -> None:
    meet(one, other)
    again = Node("uav2", session=2)
    [arrival] = again.tell(400 * MS, one)
    assert arrival.stranger
    assert [change.after for change in arrival.links] == [LinkState.HEARD]
    assert one.station.next_hop(other.hw) == 0
    meet(one, again, now_ns=500 * MS)
    assert one.station.next_hop(other.hw) == other.hw


def test_a_body_stays_within_its_limit_however_much_there_is_to_say(one: Node, other: Node) -> None:
    meet(one, other)
    offers = tuple(Offer(f"a/b{index}", index + 1, "Float") for index in range(200))
    one.station.set_plan(TreePlan(1, offers=offers))
    for board in one.station.bulletin.boards.values():
        board.put(bytes(40), False, 0)
    rows = tuple(Row(1000 + index, 1, 256) for index in range(250))
    header = Header(0, other.hw, 1000, 0)
    one.station.on_datagram(header, Tick(rows=rows), ("h", 1), 400 * MS)
    sent: set[int] = set()
    for tick in range(4, 40):
        departure = one.compose(tick * TICK)
        assert len(codec.encode(departure.tick)) <= BODY_LIMIT
        sent |= {value.data_id for value in departure.tick.values}
    assert len(sent) == 200
