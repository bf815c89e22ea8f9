"""Large values in parts: whole at the receiver, in any order, bounded, refused with words."""

import contextlib
from itertools import count
from random import Random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.model.frame import Flag, Frame, FrameKind, decode, encode
from swarmware.transport.delivery.answer import lifetime_ns, with_lifetime
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.delivery.parts import (
    FORGET_NS,
    PART_BYTES,
    VALUE_LIMIT,
    PartAssembly,
    PartHeader,
    part_header,
    parts_of,
)

PAYLOAD = Random(3).randbytes(5 * PART_BYTES + 7)
HERE = "uav1"


def whole(payload: bytes = PAYLOAD, sequence: int = 100, sender: int = 2) -> Frame:
    frame = Frame(FrameKind.MESSAGE, 9, sender, 3, 4, 5, sequence, payload=payload)
    frame.flags, frame.extension = int(Flag.WANTS_ACK), with_lifetime(5.0)
    return frame


def split(frame: Frame) -> list[Frame]:
    """The parts as they arrive."""
    sequence = count(frame.sequence + 1)
    return [decode(encode(part)) for part in parts_of(frame, lambda: next(sequence))]


class Box:
    """An inbox with room for some values."""

    def __init__(self, room: int = 9) -> None:
        self.room = room
        self.taken: list[Frame] = []

    def take(self, frame: Frame) -> Outcome | None:
        if len(self.taken) >= self.room:
            return None
        self.taken.append(frame)
        return Outcome(Status.DELIVERED, "uav1:app", received_ns=1)


@given(st.randoms(use_true_random=False))
def test_parts_in_any_order_give_value_once(random: Random) -> None:
    box, assembly = Box(), PartAssembly(HERE)
    parts = split(whole())
    arriving = parts + random.sample(parts, 3)
    random.shuffle(arriving)
    last = {part.sequence: at for at, part in enumerate(arriving)}
    for at, part in enumerate(arriving):
        if not box.taken or last[part.sequence] == at < len(parts):
            assert assembly.on_frame(part, box.take, at)
    assert [bytes(frame.payload) for frame in box.taken[:1]] == [PAYLOAD]
    assert box.taken[0].sequence == 100


def test_each_part_is_bulk_frame_of_whole() -> None:
    parts = split(whole())
    assert [len(part.payload) for part in parts] == [PART_BYTES] * 5 + [7]
    assert {part.kind for part in parts} == {FrameKind.MESSAGE}
    assert all(part.is_bulk and part.wants_ack for part in parts)
    assert all(lifetime_ns(part.extension) == 5_000_000_000 for part in parts)
    assert [part.sequence for part in parts] == list(range(100, 106))
    assert part_header(parts[2].extension) == PartHeader(100, 2, 6, len(PAYLOAD))
    assert part_header(whole().extension) is None


def test_a_whole_frame_passes() -> None:
    box = Box()
    assert PartAssembly(HERE).on_frame(whole(b"short"), box.take, 0)
    assert box.taken[0].payload == b"short"


def test_full_inbox_gets_value_with_repeated_part() -> None:
    box, assembly = Box(room=0), PartAssembly(HERE)
    *first, last = split(whole())
    for part in first:
        assert assembly.on_frame(part, box.take, 0)
    assert assembly.on_frame(last, box.take, 0) is None
    box.room = 1
    assert assembly.on_frame(last, box.take, 0)
    assert bytes(box.taken[0].payload) == PAYLOAD
    assert assembly.held_bytes == 0


def test_what_is_held_is_bounded_and_forgotten() -> None:
    box, assembly = Box(), PartAssembly(HERE, held_bytes=2 * len(PAYLOAD))
    values = [split(whole(sequence=1000 * number, sender=number)) for number in range(4)]
    assert assembly.on_frame(values[0][0], box.take, 0)
    assert assembly.on_frame(values[1][0], box.take, FORGET_NS)
    refused = assembly.on_frame(values[2][0], box.take, FORGET_NS)
    assert refused is not None
    assert str(refused).startswith(f"refused at uav1: no room for a value of {len(PAYLOAD)} bytes")
    assert assembly.on_frame(values[3][0], box.take, FORGET_NS + 1), "the first one is forgotten"
    assert assembly.held_bytes == 2 * len(PAYLOAD)


def test_mismatched_parts_are_refused() -> None:
    box, assembly = Box(), PartAssembly(HERE)
    parts = split(whole())
    assembly.on_frame(parts[0], box.take, 0)
    other = PartHeader(100, 1, 6, len(PAYLOAD) - 1).encode()
    refused = assembly.on_frame(msgspec.structs.replace(parts[1], extension=other), box.take, 0)
    assert refused is not None
    assert refused.detail == "its parts do not fit each other"
    for part in parts[1:-1]:
        assembly.on_frame(part, box.take, 0)
    short = msgspec.structs.replace(parts[-1], payload=b"123")
    refused = assembly.on_frame(short, box.take, 0)
    assert refused is not None
    assert refused.status is Status.REFUSED
    assert (box.taken, assembly.held_bytes) == ([], 0)


@pytest.mark.parametrize(
    "header",
    [PartHeader(0, 6, 6, len(PAYLOAD)), PartHeader(0, 0, 9, 10), PartHeader(0, 0, 1, VALUE_LIMIT + 1)],
)
def test_a_part_that_cannot_be_is_refused(header: PartHeader) -> None:
    with pytest.raises(WireError):
        part_header(header.encode())
    frame = msgspec.structs.replace(whole(), extension=header.encode())
    outcome = PartAssembly(HERE).on_frame(frame, Box().take, 0)
    assert outcome is not None
    assert outcome.status is Status.REFUSED


@given(st.binary(max_size=40))
def test_any_extension_is_part_or_refused(extension: bytes) -> None:
    with contextlib.suppress(WireError):
        part_header(extension)
