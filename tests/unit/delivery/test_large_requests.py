"""Requests in parts and replies that are requested in parts: the receiver's side."""

import pytest

from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.transport.delivery.large_requests import (
    HELD,
    REPLY_MAX,
    TAKEN,
    LargeRequests,
    fetch_element,
    held_bytes,
    part_count,
)
from swarmware.transport.delivery.parts import FORGET_NS, PART_BYTES, VALUE_LIMIT, PartAssembly, parts_of
from swarmware.types.rpc import Reply

HERE = "uav1:map#1"
SIZE = REPLY_MAX + 10


def request(sequence: int = 7, payload: bytes = b"", extension: bytes = b"", sender: int = 1) -> Frame:
    return Frame(FrameKind.REQUEST, 5, sender, 2, 3, 4, sequence, 0, extension=extension, payload=payload)


def fetch(number: int, sequence: int = 7, sender: int = 1) -> Frame:
    return request(1000 + number, extension=fetch_element(sequence, number), sender=sender)


def receiver(held_limit: int = 2 * VALUE_LIMIT) -> LargeRequests:
    return LargeRequests(PartAssembly(HERE), held_limit)


def reply_to(large: LargeRequests, frame: Frame, now_ns: int = 0) -> Reply:
    found = large.on_request(frame, now_ns)
    assert isinstance(found, Reply)
    return found


def test_request_in_parts_is_whole_with_last() -> None:
    large, payload = receiver(), bytes(range(256)) * 400
    numbers = iter(range(8, 100))
    parts = list(parts_of(request(payload=payload), lambda: next(numbers)))
    for part in reversed(parts[1:]):
        assert reply_to(large, part) == Reply(True, kind=TAKEN)
    whole = large.on_request(parts[0], 0)
    assert isinstance(whole, Frame)
    assert (whole.payload, whole.sequence, whole.kind) == (payload, 7, FrameKind.REQUEST)


def test_request_that_fits_frame_passes_with_reply() -> None:
    large, frame, reply = receiver(), request(payload=b"x"), Reply(True, bytes(REPLY_MAX))
    assert large.on_request(frame, 0) is frame
    assert large.on_reply(frame, reply, 0) is reply
    assert held_bytes(reply) is None


def test_large_reply_is_fetched_and_refetched_in_parts() -> None:
    large, body = receiver(), bytes(range(250)) * (SIZE // 250 + 1)
    notice = large.on_reply(request(), Reply(True, body), 0)
    assert (notice.ok, notice.kind) == (True, HELD)
    assert held_bytes(notice) == len(body)
    count = part_count(len(body))
    found = [reply_to(large, fetch(number)).body for number in range(count)]
    assert b"".join(found) == body
    assert {len(part) for part in found[:-1]} == {PART_BYTES}
    assert reply_to(large, fetch(0)).body == found[0]


def test_only_who_asked_gets_parts_of_reply() -> None:
    large = receiver()
    large.on_reply(request(), Reply(True, bytes(SIZE)), 0)
    for frame in (fetch(0, sender=9), fetch(0, sequence=8)):
        assert reply_to(large, frame) == Reply(False, kind="NoAnswer", error="the reply is no longer held")


def test_held_replies_are_bounded_in_bytes_and_time() -> None:
    large = receiver(held_limit=2 * SIZE)
    for sequence in range(3):
        large.on_reply(request(sequence), Reply(True, bytes(SIZE)), 0)
    assert [reply_to(large, fetch(0, sequence), now_ns=1).ok for sequence in range(3)] == [False, True, True]
    large.on_reply(request(9), Reply(True, bytes(SIZE)), FORGET_NS + 2)
    assert [reply_to(large, fetch(0, sequence)).ok for sequence in (1, 2, 9)] == [False, False, True]


def test_oversized_reply_is_left_for_refusal() -> None:
    reply = Reply(True, bytes(VALUE_LIMIT + 1))
    assert receiver().on_reply(request(), reply, 0) is reply


@pytest.mark.parametrize("body", [b"", b"abc", bytes(4), (REPLY_MAX).to_bytes(4, "little"), b"\xff" * 4])
def test_size_that_no_large_reply_has_is_refused(body: bytes) -> None:
    with pytest.raises(WireError, match="bytes in parts"):
        held_bytes(Reply(True, body, HELD))


def test_a_damaged_element_is_answered_with_its_error() -> None:
    element = bytes((9, 5)) + bytes(5)
    assert reply_to(receiver(), request(extension=element)).kind == "WireError"
    parts = parts_of(request(payload=bytes(PART_BYTES + 1)), lambda: 8)
    other = parts_of(request(payload=bytes(2 * PART_BYTES + 1)), lambda: 8)
    large = receiver()
    large.on_request(next(parts), 0)
    refused = reply_to(large, next(other))
    assert (refused.ok, refused.kind) == (False, "OutOfRange")
    assert "do not fit" in refused.error
