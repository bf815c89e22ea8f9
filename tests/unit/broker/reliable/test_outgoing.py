"""Frames as numbered messages: priorities, pieces, repetitions."""

from collections.abc import Sequence

from swarmd.broker.core.frames.reliable.outgoing import COMMANDS, ROOM, OutgoingMessages
from swarmd.broker.core.frames.reliable.packet import Piece
from swarmd.broker.core.frames.reliable.reassembly import SPAN_MAX
from swarmd.broker.core.frames.send_queue import AGE_MAX_NS, Priority, QueuedFrame
from swarmware.model.frame import Flag, Frame, FrameKind, encode

ALL = tuple(Priority)
T = 9_000_000_000


def queued(
    sequence: int, size: int = 10, kind: FrameKind = FrameKind.STREAM, urgent: bool = False
) -> QueuedFrame:
    flags = Flag.URGENT if urgent else Flag(0)
    frame = Frame(kind, 1, 2, 3, 4, 5, flags=flags, sequence=sequence, payload=bytes(size))
    return QueuedFrame(encode(frame), frame, T)


def pieces(outgoing: OutgoingMessages, ranks: Sequence[Priority] = ALL, room: int = ROOM) -> list[Piece]:
    """All pieces that can be sent, each in a packet of its own."""
    found: list[Piece] = []
    while (piece := outgoing.take(ranks, room, T)[0]) is not None:
        found.append(piece)
    return found


def test_commands_go_before_streams_and_those_before_files() -> None:
    outgoing = OutgoingMessages()
    kinds = [FrameKind.FILE, FrameKind.STREAM, FrameKind.NOTIFY, FrameKind.MESSAGE]
    for number, kind in enumerate(kinds):
        outgoing.put(queued(number, kind=kind))
    outgoing.put(queued(9, kind=FrameKind.STREAM, urgent=True))
    order = [outgoing.take(ALL, ROOM, T)[1] for _ in range(5)]
    assert [one.frame.sequence for one in order if one is not None] == [9, 3, 2, 1, 0]


def test_command_goes_between_pieces_of_file() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1, 5000, FrameKind.FILE))
    first = outgoing.take(ALL, ROOM, T)[0]
    outgoing.put(queued(2, 10, FrameKind.REQUEST))
    second, third = outgoing.take(ALL, ROOM, T)[0], outgoing.take(ALL, ROOM, T)[0]
    assert [one.message for one in (first, second, third) if one is not None] == [0, 1, 0]
    assert outgoing.has(ALL)
    assert not outgoing.has(COMMANDS)


def test_pieces_are_the_whole_message() -> None:
    outgoing = OutgoingMessages()
    item = queued(1, 5000)
    outgoing.put(item)
    found = pieces(outgoing)
    assert b"".join(piece.data for piece in found) == item.data
    assert [piece.offset for piece in found][:2] == [0, len(found[0].data)]
    assert outgoing.floor == 0
    for piece in found:
        outgoing.on_arrived(piece)
    assert outgoing.floor == 1
    assert len(outgoing) == 0


def test_fitting_frame_is_not_split_to_fill_packet() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1, 800))
    assert outgoing.take(ALL, 500, T)[0] is None
    assert outgoing.take(ALL, ROOM, T)[0] is not None


def test_lost_pieces_go_first_while_missing() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1))
    outgoing.put(queued(2))
    one, two = pieces(outgoing)
    outgoing.put(queued(3))
    for piece in (one, two):
        outgoing.on_lost(piece)
    outgoing.on_arrived(one)
    assert [piece.message for piece in pieces(outgoing)] == [two.message, 2]
    assert outgoing.repeated_bytes == len(two.data)
    outgoing.on_arrived(two)
    outgoing.on_lost(two)
    assert pieces(outgoing) == []
    assert outgoing.repeat((two,), copies=2) == ()


def test_copy_of_undelivered_frame_is_not_sent() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1))
    outgoing.put(queued(1))
    [piece] = pieces(outgoing)
    outgoing.put(queued(1))
    assert pieces(outgoing) == []
    outgoing.on_arrived(piece)
    outgoing.put(queued(1))
    assert len(pieces(outgoing)) == 1, "its answer may have been lost behind the neighbour"


def test_old_frames_are_dropped_instead_of_begun() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1))
    piece, begun, gone = outgoing.take(ALL, ROOM, T + AGE_MAX_NS + 1)
    assert (piece, begun) == (None, None)
    assert [one.frame.sequence for one in gone] == [1]
    outgoing.put(queued(1))
    assert len(pieces(outgoing)) == 1


def test_not_more_messages_begin_than_a_receiver_takes() -> None:
    outgoing = OutgoingMessages()
    for number in range(SPAN_MAX + 10):
        outgoing.put(queued(number, 0))
        pieces(outgoing)
    assert outgoing.floor == 0
    assert not outgoing.has(ALL)


def test_undelivered_frames_are_returned_by_priority() -> None:
    outgoing = OutgoingMessages()
    outgoing.put(queued(1, kind=FrameKind.FILE))
    outgoing.put(queued(2, kind=FrameKind.STREAM))
    [first, second] = pieces(outgoing)
    outgoing.put(queued(3, kind=FrameKind.MESSAGE))
    assert first.message == 0
    assert [one.frame.sequence for one in outgoing.clear()] == [2, 1, 3]
    assert outgoing.floor == second.message + 1, "the numbers continue"
    assert not outgoing.has(ALL)
