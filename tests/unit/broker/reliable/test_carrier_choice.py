"""When frames leave the connections to a neighbour, and how much these may hold."""

import pytest

from swarmd.broker.config import Config, FrameCarrier
from swarmd.broker.core.frames.carrier_choice import CLEAN_NS, QUEUE_NS, UNOPENED_NS, LinkQuality
from swarmd.broker.core.frames.reliable.link_action import SendPacket
from swarmd.broker.core.frames.reliable.reliable_links import (
    CHECK_NS,
    Action,
    MeasureConnection,
    ReliableLinks,
    SetBuffer,
    UseDatagrams,
)
from swarmd.broker.core.frames.send_buffer import FREE_NS, SIZE_MAX, SIZE_MIN
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.links.link import ConnectionDelay
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.transport.retransmission.rate_control import PACKET_BYTES, WINDOW_MIN

UAV1, UAV2, SESSION = 0xA1, 0xA2, 7
MS = 1_000_000
S = 1000 * MS
MIN_NS = 5 * MS


def looked(
    links: ReliableLinks, excess_ns: int, now_ns: int = 0, *, waiting: bool = True, min_ns: int = MIN_NS
) -> list[Action]:
    """What follows from one look at the connections."""
    return links.on_connection(UAV1, ConnectionDelay(min_ns + excess_ns, min_ns), waiting, now_ns)


def test_connections_are_measured_while_frames_wait_for_them() -> None:
    links = ReliableLinks(Config())
    assert links.deadline_ns() is None
    links.on_waiting(UAV1, 0)
    links.on_waiting(UAV1, CHECK_NS // 2)
    assert links.deadline_ns() == CHECK_NS, "the first frame counts"
    assert links.on_timer(CHECK_NS - 1) == []
    assert links.on_timer(CHECK_NS) == [MeasureConnection(UAV1)]
    assert links.deadline_ns() is None
    looked(links, 0, CHECK_NS)
    assert links.deadline_ns() == 2 * CHECK_NS, "they still wait"
    links.on_timer(2 * CHECK_NS)
    assert looked(links, 0, 2 * CHECK_NS, waiting=False) == []
    assert links.deadline_ns() is None


def test_blocking_queue_is_left_within_two_looks() -> None:
    links = ReliableLinks(Config())
    assert looked(links, QUEUE_NS + MS) == [SetBuffer(UAV1, SIZE_MIN)]
    assert not links.is_clean(UAV1)
    assert looked(links, QUEUE_NS + MS, CHECK_NS) == [SetBuffer(UAV1, SIZE_MIN), UseDatagrams(UAV1)]
    assert links.uses_datagrams(UAV1)
    links.on_waiting(UAV1, CHECK_NS)
    assert looked(links, QUEUE_NS + MS, 2 * CHECK_NS) == [SetBuffer(UAV1, SIZE_MIN)], "it moves once"


def test_single_look_or_unused_queue_proves_nothing() -> None:
    links = ReliableLinks(Config())
    for excess_ns in (QUEUE_NS + MS, QUEUE_NS, QUEUE_NS + MS):
        looked(links, excess_ns)
    assert not links.uses_datagrams(UAV1)
    links = ReliableLinks(Config())
    for _ in range(5):
        looked(links, 10 * QUEUE_NS, waiting=False)
    for _ in range(5):
        links.on_connection(UAV1, None, True, 0)
    assert not links.uses_datagrams(UAV1), "a connection that is being opened has no round trip"


def test_initial_overload_is_seen_by_round_trip() -> None:
    links = ReliableLinks(Config())
    links.on_quality(UAV1, LinkQuality(0.0, 400 * MS), 0)  # the first beacons wait in the queue
    looked(links, 300 * MS)
    links.on_quality(UAV1, LinkQuality(0.0, 400 * MS), S)
    assert not links.is_clean(UAV1)
    links.on_quality(UAV1, LinkQuality(0.0, 400 * MS), 2 * S)
    assert links.uses_datagrams(UAV1)
    links.on_frame(UAV1, SESSION, item(1), 2 * S)
    link = links.link(UAV1)
    assert link is not None
    base_ns = link.rate.delay.minimum_ns
    assert base_ns is not None
    assert base_ns < 2 * MIN_NS + 400 * MS // 32


def test_buffer_grows_as_limit_and_shrinks_with_queue() -> None:
    links = ReliableLinks(Config())
    sizes: list[int] = []
    for look in range(10):
        [action] = looked(links, FREE_NS, look * CHECK_NS)
        assert isinstance(action, SetBuffer)
        sizes.append(action.size)
    assert SIZE_MIN < sizes[0] < 2 * SIZE_MIN
    assert sizes == sorted(sizes)
    assert SIZE_MAX <= sizes[-1] < 2 * SIZE_MAX
    assert looked(links, QUEUE_NS + 1, S) == [SetBuffer(UAV1, SIZE_MIN)]


def unopened(links: ReliableLinks, from_ns: int, until_ns: int) -> list[Action]:
    """Checks connections that do not open, while frames wait for them."""
    return [
        action
        for now_ns in range(from_ns, until_ns, CHECK_NS)
        for action in links.on_connection(UAV1, None, True, now_ns)
    ]


def test_frames_awaiting_connection_take_datagrams() -> None:
    links = ReliableLinks(Config())
    assert unopened(links, 0, UNOPENED_NS) == []
    assert unopened(links, UNOPENED_NS, UNOPENED_NS + S) == [UseDatagrams(UAV1)]
    clean = LinkQuality(0.0)
    for second in range(4, 60):
        links.on_quality(UAV1, LinkQuality(0.0, is_opening=True), second * S)
    assert links.uses_datagrams(UAV1)
    for second in range(60, 62 + CLEAN_NS // S):
        links.on_quality(UAV1, clean, second * S)
    assert not links.uses_datagrams(UAV1), "it is open now"


def test_late_or_pinned_connection_keeps_its_frames() -> None:
    links = ReliableLinks(Config())
    unopened(links, 0, UNOPENED_NS)
    looked(links, 0, UNOPENED_NS)
    assert unopened(links, UNOPENED_NS, 2 * UNOPENED_NS) == []
    pinned = ReliableLinks(Config(frames=FrameCarrier.TCP))
    assert unopened(pinned, 0, 5 * UNOPENED_NS) == []


def test_pinned_connection_is_kept_with_smallest_buffer() -> None:
    links = ReliableLinks(Config(frames=FrameCarrier.TCP))
    found = [looked(links, 10 * QUEUE_NS) for _ in range(5)]
    assert found == [[SetBuffer(UAV1, SIZE_MIN)]] * 5


def test_a_lost_neighbour_is_not_measured() -> None:
    links = ReliableLinks(Config())
    links.on_waiting(UAV1, 0)
    links.on_waiting(UAV2, MS)
    links.on_gone(UAV1, MS)
    assert links.on_timer(S) == [MeasureConnection(UAV2)]


def item(sequence: int) -> QueuedFrame:
    frame = Frame(FrameKind.STREAM, 1, 2, 3, UAV1, 5, sequence=sequence, payload=bytes(1000))
    return QueuedFrame(encode(frame), frame, 0)


def sent(links: ReliableLinks, now_ns: int, until_ns: int) -> int:
    """Packets until an instant, of thirty items that begin now and are not acknowledged."""
    actions: list[Action] = []
    for number in range(30):
        actions += links.on_frame(UAV1, SESSION, item(1000 + number + now_ns), now_ns)
    while (due_ns := links.deadline_ns()) is not None and due_ns < until_ns:
        actions += links.on_timer(due_ns)
    return sum(isinstance(action, SendPacket) for action in actions)


@pytest.mark.parametrize("is_known", [False, True], ids=["first", "used before"])
def test_datagrams_behind_queue_begin_with_least_window(is_known: bool) -> None:
    links = ReliableLinks(Config())
    links.on_quality(UAV1, LinkQuality(0.0, MIN_NS), 0)
    if is_known:
        links.on_frame(UAV1, SESSION, item(1), 0)
    for _ in range(2):
        looked(links, 200 * MS)
    packets = sent(links, S, S + 150 * MS)
    assert packets <= WINDOW_MIN // PACKET_BYTES + 1
    free = ReliableLinks(Config())
    free.on_quality(UAV1, LinkQuality(0.0, MIN_NS), 0)
    assert sent(free, S, S + 150 * MS) > 2 * packets
