"""One link: acknowledgements ride with data, probes repeat the oldest packet, commands pass a full window."""

from swarmd.broker.core.frames.reliable.link_action import LinkAction, SendPacket
from swarmd.broker.core.frames.reliable.packet import PACKET_MAX, Acknowledgement, Packet, decode, encode
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS
from swarmd.broker.core.frames.reliable.reliable_link import ReliableLink
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.frame import encode as encode_frame
from swarmware.transport.retransmission.rate_control import WINDOW_FIRST

MS = 1_000_000


def link() -> ReliableLink:
    return ReliableLink(1, 7, 20 * MS, 0.0, 0)


def queued(sequence: int, size: int = 20, kind: FrameKind = FrameKind.STREAM) -> QueuedFrame:
    frame = Frame(kind, 1, 2, 3, 4, 5, sequence=sequence, payload=bytes(size))
    return QueuedFrame(encode_frame(frame), frame, 0)


def packets(actions: list[LinkAction]) -> list[Packet]:
    return [decode(one.data) for one in actions if isinstance(one, SendPacket)]


def arrive(
    one: ReliableLink, number: int, now_ns: int, acknowledges: tuple[int, int] | None = None
) -> list[Packet]:
    """What it sends after a packet of the neighbour, which asks for an acknowledgement."""
    acknowledgement = None if acknowledges is None else Acknowledgement((acknowledges,), 0)
    data = encode(Packet(number, 0, acknowledgement, (), acknowledges is None))
    return packets(one.on_packet(data, now_ns))


def test_acknowledgement_rides_in_next_packet_or_goes_alone() -> None:
    one = link()
    assert arrive(one, 0, 0) == []
    [packet] = packets(one.on_frame(queued(1), 1))
    assert packet.acknowledgement is not None
    assert packet.acknowledgement.ranges == ((0, 0),)
    assert arrive(one, 1, 2) == []
    assert one.deadline_ns() == 2 + ACK_DELAY_NS
    [packet] = packets(one.on_due(2 + ACK_DELAY_NS))
    assert packet.pieces == ()
    assert packet.acknowledgement is not None
    assert packet.acknowledgement.largest == 1


def test_small_frames_share_packet_when_window_opens() -> None:
    one = link()
    sent = packets([action for number in range(40) for action in one.on_frame(queued(number, 1000), 0)])
    waiting = 40 - len(sent)
    assert waiting > 20
    assert sum(len(encode(packet)) for packet in sent) <= WINDOW_FIRST + PACKET_MAX
    for number in range(100, 140):
        one.on_frame(queued(number), 0)
    later: list[Packet] = []
    for number in range(200):
        due_ns = one.deadline_ns()
        newest = (later or sent)[-1].number
        later += arrive(one, number, due_ns or 0, (0, newest))
    assert max(len(packet.pieces) for packet in later) > 5


def test_a_command_passes_a_full_window() -> None:
    one = link()
    for number in range(40):
        one.on_frame(queued(number, 1000), 0)
    assert packets(one.on_frame(queued(99, 1000), 0)) == []
    [packet] = packets(one.on_frame(queued(100, kind=FrameKind.REQUEST), 0))
    assert packet.pieces[0].total < 100


def test_probe_repeats_oldest_packet_once_then_twice() -> None:
    one = link()
    [first] = packets(one.on_frame(queued(1, 500), 0))
    one.on_frame(queued(2, 500), 0)
    due_ns = one.deadline_ns()
    assert due_ns is not None
    [probe] = packets(one.on_due(due_ns))
    assert probe.pieces == first.pieces
    due_ns = one.deadline_ns()
    assert due_ns is not None
    again = packets(one.on_due(due_ns))
    assert [packet.pieces for packet in again] == [first.pieces] * 2
    assert one.repeated_bytes == 3 * len(first.pieces[0].data)


def test_what_arrived_meanwhile_is_not_repeated() -> None:
    one = link()
    [first] = packets(one.on_frame(queued(1, 500), 0))
    due_ns = one.deadline_ns()
    assert due_ns is not None
    [probe] = packets(one.on_due(due_ns))
    assert first.pieces == probe.pieces
    assert arrive(one, 0, due_ns + MS, (probe.number, probe.number)) == []
    assert len(one) == 0
    assert one.deadline_ns() is None


def test_full_packet_leaves_acknowledgement_to_another() -> None:
    one = link()
    for number in range(0, 60, 2):
        one.on_packet(encode(Packet(number, 0, None, (), ping=False)), 0)
    one.on_packet(encode(Packet(62, 0, None, (), ping=True)), 0)
    sent = packets(one.on_frame(queued(1, PACKET_MAX - 90), MS))
    assert all(len(encode(packet)) <= PACKET_MAX for packet in sent)
    assert sum(packet.acknowledgement is not None for packet in sent) <= 1
