"""Where frames go, who waits in which queue, and who is who."""

from typing import Final

import pytest

from swarmd.broker.core.beacon.beacon import Hello, MemberRow, PlatformCode
from swarmd.broker.core.beacon.beacon_rate import airtime_s, allowed_hz
from swarmd.broker.core.frames.forwarder import LOOP_NS, ForwardDecision, ForwardStep, FrameForwarder
from swarmd.broker.core.frames.send_queue import (
    AGE_MAX_NS,
    BYTES_MAX,
    FRAMES_MAX,
    ConnectionClass,
    Priority,
    SendQueue,
    priority,
)
from swarmd.broker.core.swarm.node_table import FORGET_NS, REPEAT_NS, NodeTable
from swarmd.broker.core.swarm.routes.routing_table import RoutingTable
from swarmd.broker.core.traffic import CHANNEL_LIMIT, Counters
from swarmware.model.frame import HOPS, Flag, Frame, FrameKind
from swarmware.model.names import hardware_id

ME, A, B, FAR = 1, 2, 3, 9
MS: Final = 1_000_000
NOBODY: Final[frozenset[int]] = frozenset()


@pytest.fixture
def forwarder() -> FrameForwarder:
    routing = RoutingTable(ME)
    routing.set_link(A, 256)
    routing.on_rows(A, [(A, 1, 0), (FAR, 1, 256)], 0)
    return FrameForwarder(ME, routing)


def frame(
    kind: FrameKind = FrameKind.MESSAGE,
    *,
    sender: int = ME,
    receiver: int = FAR,
    hops: int = HOPS,
    sequence: int = 1,
) -> Frame:
    return Frame(kind, 5, sender, 6, receiver, 7, sequence, hops_left=hops)


def test_own_frame_goes_to_next_hop_with_hops(forwarder: FrameForwarder) -> None:
    one = frame(hops=3)
    assert forwarder.from_here(one, 0) == ForwardDecision(ForwardStep.SEND, A)
    assert one.hops_left == HOPS


def test_refusal_for_another_does_not_start_here(forwarder: FrameForwarder) -> None:
    one = frame(FrameKind.ACK, sender=B)
    forwarder.from_here(one, 0)
    assert one.hops_left == HOPS - 1


def test_frame_without_route_stays_and_requests_route(forwarder: FrameForwarder) -> None:
    assert forwarder.from_here(frame(receiver=77), 0).step is ForwardStep.NO_ROUTE


def test_a_frame_for_us_is_delivered(forwarder: FrameForwarder) -> None:
    assert forwarder.from_neighbour(frame(sender=A, receiver=ME), A, 0).step is ForwardStep.DELIVER


def test_forwarded_frame_has_one_hop_less(forwarder: FrameForwarder) -> None:
    one = frame(sender=B)
    assert forwarder.from_neighbour(one, B, 0) == ForwardDecision(ForwardStep.SEND, A)
    assert one.hops_left == HOPS - 1


def test_frame_starting_at_neighbour_must_be_its_own(forwarder: FrameForwarder) -> None:
    assert forwarder.from_neighbour(frame(sender=FAR, receiver=ME), A, 0).step is ForwardStep.SPOOFED
    relayed = frame(sender=FAR, receiver=ME, hops=HOPS - 1)
    assert forwarder.from_neighbour(relayed, A, 0).step is ForwardStep.DELIVER


def test_unverifiable_neighbour_frames_are_accepted(forwarder: FrameForwarder) -> None:
    assert forwarder.from_neighbour(frame(sender=FAR, receiver=ME), None, 0).step is ForwardStep.DELIVER


def test_the_last_hop_is_the_last(forwarder: FrameForwarder) -> None:
    assert forwarder.from_neighbour(frame(sender=B, hops=1), B, 0).step is ForwardStep.HOP_LIMIT


def test_a_frame_that_comes_round_is_stopped(forwarder: FrameForwarder) -> None:
    forwarder.from_neighbour(frame(sender=B, hops=10), B, 0)
    assert forwarder.from_neighbour(frame(sender=B, hops=7), A, 5 * MS).step is ForwardStep.LOOPED
    own = frame(hops=20)
    assert forwarder.from_neighbour(own, A, 0).step is ForwardStep.LOOPED


def test_repetition_by_sender_passes_but_is_not_first(forwarder: FrameForwarder) -> None:
    assert forwarder.from_neighbour(frame(sender=B, hops=10), B, 0).first
    reroute = forwarder.from_neighbour(frame(sender=B, hops=10), B, 5 * MS)
    assert (reroute.step, reroute.first) == (ForwardStep.SEND, False)
    over_another_way = forwarder.from_neighbour(frame(sender=B, hops=9), A, 5 * MS + LOOP_NS)
    assert over_another_way.step is ForwardStep.SEND


def test_an_urgent_frame_is_first_whatever_it_is() -> None:
    urgent = frame(FrameKind.FILE)
    urgent.flags = Flag.URGENT
    assert priority(urgent) is Priority.URGENT


def test_full_queue_drops_oldest_of_lowest_priority() -> None:
    queue = SendQueue()
    for index in range(FRAMES_MAX):
        assert queue.put(b"%d" % index, frame(FrameKind.STREAM), index) == []
    [gone] = queue.put(b"new", frame(FrameKind.STREAM), 0)
    assert gone.data == b"0"
    [gone] = queue.put(b"file", frame(FrameKind.FILE), 0)
    assert gone.data == b"file"


def test_the_queue_is_bounded_in_bytes() -> None:
    queue = SendQueue()
    gone = [item for _ in range(9) for item in queue.put(bytes(BYTES_MAX // 8), frame(FrameKind.FILE), 0)]
    assert len(gone) == 1


def test_frame_waiting_too_long_is_given_up() -> None:
    queue = SendQueue()
    queue.put(b"old", frame(), 0)
    queue.put(b"new", frame(), AGE_MAX_NS)
    waiting, old = queue.peek(ConnectionClass.CONTROL, AGE_MAX_NS + 1)
    assert [item.data for item in old] == [b"old"]
    assert waiting is not None
    assert waiting.data == b"new"


def test_closed_way_returns_all_waiting_frames() -> None:
    queue = SendQueue()
    for kind in (FrameKind.FILE, FrameKind.ACK):
        queue.put(kind.name.encode(), frame(kind), 0)
    assert [item.data for item in queue.clear()] == [b"ACK", b"FILE"]
    assert [queue.peek(each, 0) for each in ConnectionClass] == [(None, [])] * 2


def hello(name: str, tree_version: int = 1) -> Hello:
    return Hello(1, 0, 1, tree_version, 0, PlatformCode.UAV, name)


UAV2 = hardware_id("uav2")
FC1 = hardware_id("uav2", "fc1")


def test_a_node_is_who_its_hardware_id_says() -> None:
    members = NodeTable(ME)
    assert members.on_hello(UAV2, hello("uav2"), 0)
    assert members.on_hello(FC1, hello("uav2.fc1"), 0)
    assert not members.on_hello(UAV2, hello("uav3"), 0)
    assert not members.on_hello(hardware_id("Uav 3"), hello("Uav 3"), 0)
    assert members.platform(FC1) == "uav2"
    assert members.platform(0xABC) == "00000abc"


def test_far_member_is_sent_three_times_then_seldom() -> None:
    members = NodeTable(ME)
    members.on_row(MemberRow(UAV2, 1, PlatformCode.UAV, "uav2"), 1)

    def said(now_ns: int) -> list[MemberRow]:
        return members.rows(now_ns, 500, NOBODY, lambda _: A)

    assert [len(said(slot)) for slot in range(2, 7)] == [1, 1, 1, 0, 0]
    assert len(said(REPEAT_NS + 5)) == 1
    members.on_row(MemberRow(UAV2, 2, PlatformCode.UAV, "uav2"), REPEAT_NS + 6)
    assert [row.tree_version for row in said(REPEAT_NS + 7)] == [2]


def test_member_rows_are_repeated_for_new_neighbours() -> None:
    members = NodeTable(ME)
    members.on_row(MemberRow(UAV2, 1, PlatformCode.UAV, "uav2"), 1)
    for slot in range(4):
        members.rows(slot, 500, NOBODY, lambda _: A)
    assert members.rows(5, 500, NOBODY, lambda _: A) == []
    members.announce_again()
    assert len(members.rows(6, 500, NOBODY, lambda _: A)) == 1
    assert members.rows(7, 500, NOBODY, lambda _: A) == []


def test_known_or_unreachable_members_are_not_sent() -> None:
    members = NodeTable(ME)
    members.on_hello(UAV2, hello("uav2"), 1)
    assert members.rows(2, 500, frozenset((UAV2,)), lambda _: A) == []
    assert members.rows(2, 500, NOBODY, lambda _: 0) == []
    assert members.rows(2, 5, NOBODY, lambda _: A) == []


def test_the_roster_gives_names_but_no_rows() -> None:
    members = NodeTable(ME)
    members.add("uav2", 0)
    assert members.platform(UAV2) == "uav2"
    assert members.rows(1, 500, NOBODY, lambda _: A) == []


def test_whom_nobody_mentions_is_forgotten() -> None:
    members = NodeTable(ME)
    members.on_hello(UAV2, hello("uav2"), 1)
    members.forget(FORGET_NS + 2)
    assert members.get(UAV2) is None


@pytest.mark.parametrize(
    ("wanted_hz", "heard", "size", "expected_hz"),
    [(10.0, 15, 150, 10.0), (10.0, 99, 300, 4.4), (10.0, 400, 600, 0.64), (2.0, 15, 150, 2.0)],
)
def test_beacons_leave_three_quarters_of_the_air(
    wanted_hz: float, heard: int, size: int, expected_hz: float
) -> None:
    assert min(wanted_hz, allowed_hz(heard, size)) == pytest.approx(expected_hz, rel=0.05)


def test_airtime_is_that_of_the_scale_study() -> None:
    assert [round(airtime_s(size) * 1e6) for size in (180, 300, 600)] == pytest.approx(
        [413, 573, 973], rel=0.01
    )


def test_channels_beyond_the_limit_share_their_counters() -> None:
    counters = Counters()
    for index in range(CHANNEL_LIMIT + 10):
        counters.channel(f"a/{index}").sent(1)
    assert len(counters.channels) == CHANNEL_LIMIT + 1
    assert counters.channel("other").sent_frames == 10


def test_counters_are_told_with_their_names() -> None:
    counters = Counters()
    counters.datagram_sent(100, "*")
    counters.datagram_received(50, "uav2")
    counters.channel("nav/pose").received(24)
    counters.refused.forged += 1
    sent, received = counters.link_table()
    assert (sent.platform, sent.transport, sent.sent_frames, sent.sent_bytes) == ("*", "udp", 1, 128)
    assert (received.platform, received.received_frames, received.received_bytes) == ("uav2", 1, 78)
    assert counters.channel_table()[0].received_bytes == 24
    assert counters.refused_table().forged == 1
