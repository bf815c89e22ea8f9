"""Which neighbours get their frames in datagrams, and the sessions of their links."""

from collections.abc import Iterable

import pytest

from swarmd.broker.config import Config, FrameCarrier
from swarmd.broker.core.frames.carrier_choice import CLEAN_NS, LinkQuality
from swarmd.broker.core.frames.reliable.link_action import DeliverFrame, FrameBegun, FramesDropped, SendPacket
from swarmd.broker.core.frames.reliable.packet import Acknowledgement, Packet, Piece, decode, encode
from swarmd.broker.core.frames.reliable.reliable_link import BLOCKED, BLOCKED_LATER, ReliableLink
from swarmd.broker.core.frames.reliable.reliable_links import (
    BLOCKED_NS,
    Action,
    ReliableLinks,
    UseConnection,
    UseDatagrams,
)
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.frame import encode as encode_frame

S = 1_000_000_000
UAV1, SESSION = 0xA1, 77


def queued(
    sequence: int, size: int = 20, kind: FrameKind = FrameKind.MESSAGE, now_ns: int = 0
) -> QueuedFrame:
    frame = Frame(kind, 1, 2, 3, UAV1, 5, sequence=sequence, payload=bytes(size))
    return QueuedFrame(encode_frame(frame), frame, now_ns)


def packets(actions: Iterable[Action]) -> list[Packet]:
    return [decode(one.data) for one in actions if isinstance(one, SendPacket)]


def chosen(links: ReliableLinks, losses: list[float], first_s: int = 0) -> list[bool]:
    """Whether datagrams are used after each second with these losses."""
    found: list[bool] = []
    for second, loss in enumerate(losses, first_s):
        links.on_quality(UAV1, LinkQuality(loss), second * S)
        found.append(links.uses_datagrams(UAV1))
    return found


def test_lossy_link_gets_datagrams_within_two_seconds() -> None:
    assert chosen(ReliableLinks(Config()), [0.3]) == [True]
    assert chosen(ReliableLinks(Config()), [0.1, 0.1]) == [False, True]


def test_clean_link_and_single_loss_stay_with_connection() -> None:
    assert not any(chosen(ReliableLinks(Config()), [0.0, 0.0625, 0.0, 0.0, 0.0625, 0.0]))


def test_measured_link_is_clean_without_loss_or_lateness() -> None:
    links = ReliableLinks(Config())
    assert not links.is_clean(UAV1), "nothing is known of it"
    found: list[bool] = []
    for loss, rtt_ms in [(0.0, 20), (0.1, 20), *[(0.0, 20)] * 5, (0.0, 120)]:
        links.on_quality(UAV1, LinkQuality(loss, rtt_ms * 1_000_000), 0)
        found.append(links.is_clean(UAV1))
    assert found == [True, *[False] * 3, *[True] * 3, False]
    for carrier in (FrameCarrier.TCP, FrameCarrier.UDP):
        fixed = ReliableLinks(Config(frames=carrier))
        fixed.on_quality(UAV1, LinkQuality(0.0), 0)
        assert not fixed.is_clean(UAV1), "the configuration has chosen"


def seconds_with(links: ReliableLinks, round_trips_ms: list[int], first_s: int = 0) -> list[bool]:
    """Whether datagrams are used after each second with these round trips, without loss."""
    found: list[bool] = []
    for second, rtt_ms in enumerate(round_trips_ms, first_s):
        links.on_quality(UAV1, LinkQuality(0.0, rtt_ms * 1_000_000), second * S)
        found.append(links.uses_datagrams(UAV1))
    return found


def test_link_whose_queue_connection_fills_gets_datagrams() -> None:
    assert seconds_with(ReliableLinks(Config()), [20, 30, 90, 110]) == [False, False, False, True]
    assert not any(seconds_with(ReliableLinks(Config()), [20, 120, 20, 120, 20])), "one second proves nothing"
    assert not any(seconds_with(ReliableLinks(Config()), [200, 0, 220, 200])), "a long way is no queue"


def test_a_full_link_keeps_its_datagrams() -> None:
    links = ReliableLinks(Config())
    seconds_with(links, [20, 120, 120])
    for number in range(100):
        links.on_frame(UAV1, SESSION, queued(number, 1000), 3 * S)
    assert all(seconds_with(links, [30] * 60, first_s=3))
    links.on_gone(UAV1, 63 * S)
    assert not seconds_with(links, [30] * 60, first_s=63)[-1]


def test_link_without_loss_regains_its_connection() -> None:
    links = ReliableLinks(Config())
    chosen(links, [0.3])
    seconds = chosen(links, [0.0] * 60, first_s=1)
    assert CLEAN_NS // S < seconds.index(False) < CLEAN_NS // S + 12
    links = ReliableLinks(Config())
    chosen(links, [0.3])
    assert all(chosen(links, [0.0, 0.0, 0.0, 0.1] * 20, first_s=1)), "it does not change back and forth"


def test_one_carrier_can_be_pinned() -> None:
    assert not any(chosen(ReliableLinks(Config(frames=FrameCarrier.TCP)), [0.5] * 5))
    assert all(chosen(ReliableLinks(Config(frames=FrameCarrier.UDP)), [0.0] * 60))


def test_packets_are_answered_on_their_own_path() -> None:
    there = ReliableLinks(Config())
    [sent] = [one for one in there.on_frame(3, 5, queued(1), 0) if isinstance(one, SendPacket)]
    links = ReliableLinks(Config())
    assert chosen(links, [0.0625]) == [False]
    assert UseDatagrams(UAV1) in links.on_packet(UAV1, SESSION, sent.data, None, S)
    assert links.uses_datagrams(UAV1)
    clean = ReliableLinks(Config())
    chosen(clean, [0.0])
    clean.on_packet(UAV1, SESSION, sent.data, None, S)
    assert not clean.uses_datagrams(UAV1)


def test_what_waits_for_the_connection_moves_once() -> None:
    links = ReliableLinks(Config())
    assert links.on_quality(UAV1, LinkQuality(0.4), 0) == [UseDatagrams(UAV1)]
    assert links.on_quality(UAV1, LinkQuality(0.4), S) == []


def test_a_frame_is_sent_counted_and_delivered() -> None:
    here, there = ReliableLinks(Config()), ReliableLinks(Config())
    item = queued(1)
    actions = here.on_frame(UAV1, SESSION, item, 0)
    assert FrameBegun(UAV1, item) in actions
    [sent] = [one for one in actions if isinstance(one, SendPacket)]
    assert (sent.hw, sent.session) == (UAV1, SESSION)
    assert there.on_packet(3, 5, sent.data, None, S) == [DeliverFrame(3, item.data)]
    assert there.on_packet(3, 5, sent.data, None, S)[:1] != [DeliverFrame(3, item.data)]


def test_restarted_neighbour_gets_undelivered_frames() -> None:
    links = ReliableLinks(Config())
    for number in range(3):
        links.on_frame(UAV1, SESSION, queued(number), 0)
    link = links.link(UAV1)
    found = packets(links.on_frame(UAV1, SESSION + 1, queued(9), S))
    assert links.link(UAV1) is not link
    assert [piece.message for packet in found for piece in packet.pieces] == [0, 1, 2, 3]
    assert found[0].number == 0


def unanswered(links: ReliableLinks) -> int:
    """Probes a neighbour in vain; the instant after the last one."""
    chosen(links, [0.3])
    links.on_frame(UAV1, SESSION, queued(1), 0)
    now_ns = 0
    for _ in range(BLOCKED):
        now_ns = links.deadline_ns() or 0
        assert packets(links.on_timer(now_ns))
    return now_ns


def test_neighbour_that_acknowledges_nothing_gets_connection_for_while() -> None:
    links = ReliableLinks(Config())
    now_ns = unanswered(links)
    [back] = links.on_quality(UAV1, LinkQuality(0.3), now_ns)
    assert isinstance(back, UseConnection)
    assert [one.frame.sequence for one in back.frames] == [1]
    assert links.deadline_ns() is None
    assert not links.uses_datagrams(UAV1)
    assert links.on_quality(UAV1, LinkQuality(0.3), now_ns + BLOCKED_NS - 1) == []
    assert links.on_quality(UAV1, LinkQuality(0.3), now_ns + BLOCKED_NS) == [UseDatagrams(UAV1)]


def test_acknowledging_neighbour_may_be_silent_for_seconds() -> None:
    links = ReliableLinks(Config())
    chosen(links, [0.3])
    links.on_frame(UAV1, SESSION, queued(1), 0)
    links.on_packet(UAV1, SESSION, encode(Packet(0, 0, Acknowledgement(((0, 0),), 0), ())), None, 20_000_000)
    links.on_frame(UAV1, SESSION, queued(2), S)
    now_ns = S
    for _ in range(BLOCKED_LATER - 1):
        now_ns = links.deadline_ns() or 0
        links.on_timer(now_ns)
    assert now_ns > 5 * S, "a busy computer answers after less"
    assert links.on_quality(UAV1, LinkQuality(0.3), now_ns) == []
    now_ns = links.deadline_ns() or 0
    links.on_timer(now_ns)
    assert isinstance(links.on_quality(UAV1, LinkQuality(0.3), now_ns)[0], UseConnection)


def test_outage_of_whole_link_continues() -> None:
    links = ReliableLinks(Config())
    now_ns = unanswered(links)
    assert links.on_quality(UAV1, LinkQuality(0.9), now_ns) == []
    assert packets(links.on_timer(links.deadline_ns() or 0))


def test_lost_neighbour_returns_frames_and_continues_numbers() -> None:
    links = ReliableLinks(Config())
    chosen(links, [0.3])
    links.on_frame(UAV1, SESSION, queued(1), 0)
    assert [one.frame.sequence for one in links.on_gone(UAV1, S)] == [1]
    assert links.deadline_ns() is None
    assert links.uses_datagrams(UAV1), "when it returns, the link is as lossy as before"
    assert links.on_gone(UAV1 + 1, S) == []
    [packet] = packets(links.on_frame(UAV1, SESSION, queued(2), 2 * S))
    assert (packet.number, packet.floor) == (1, 1)
    assert [piece.message for piece in packet.pieces] == [1]


def test_garbage_and_acknowledgements_of_nothing_are_refused() -> None:
    link = ReliableLink(UAV1, SESSION, 0, 0.0, 0)
    bad = [
        b"",
        b"garbage",
        bytes(8) + b"\x01\x05\0\0\0\0\0\0\0\0",
        encode(Packet(0, 0, None, (Piece(900_000, 1, 0, b"x"),))),
    ]
    for data in bad:
        with pytest.raises(WireError):
            link.on_packet(data, 0)
    assert link.deadline_ns() is None


def test_frames_that_are_too_many_are_reported() -> None:
    links = ReliableLinks(Config())
    dropped: list[QueuedFrame] = []
    for number in range(4000):
        actions = links.on_frame(UAV1, SESSION, queued(number, 1000, FrameKind.STREAM), 0)
        dropped += [one for action in actions if isinstance(action, FramesDropped) for one in action.frames]
    assert dropped
    assert len(links.link(UAV1) or ()) + len(dropped) == 4000
