"""The receiver's side of delivery: nothing twice, the same answer each time."""

from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.frame import Frame, FrameKind
from swarmware.transport.delivery.answer import expired, expired_here, lifetime_ns, with_lifetime
from swarmware.transport.delivery.duplicates import DuplicateFilter, DuplicateState
from swarmware.types.time import Conversion

A, B, C = (1, 2, 3, 4), (1, 2, 3, 5), (1, 2, 3, 6)


def test_a_repeated_message_gets_the_same_answer() -> None:
    received = DuplicateFilter()
    assert received.lookup(A) is None
    received.answered(A, b"yes", 0)
    assert received.lookup(A) == b"yes"
    assert received.lookup(B) is None
    assert received.duplicates == 1


def test_a_repeated_request_waits_for_the_one_answer() -> None:
    received = DuplicateFilter()
    received.begin(A, 0)
    assert received.lookup(A) is DuplicateState.IN_WORK
    received.answered(A, b"42", 5)
    assert received.lookup(A) == b"42"


FAR = 1 << 20
"""Sequences so far apart are of different starts of their sender."""


def test_messages_are_known_after_answers_are_gone() -> None:
    received = DuplicateFilter(answers=100)
    for sequence in range(20_000):
        for sender in range(4):
            origin = (sender, 2, 3, (sequence * 7) & 0xFFFF_FFFF)
            assert received.lookup(origin) is None
            received.answered(origin, b"x", sequence * 1_000_000)
    for sequence in range(20_000):
        assert received.lookup((3, 2, 3, sequence * 7)) is not None
    assert received.lookup((3, 2, 3, 5)) is None
    assert received.spans < 1_000


def test_messages_come_in_any_order_and_wrap() -> None:
    received = DuplicateFilter()
    last = 0xFFFF_FFFF
    for sequence in (3, last, 0, last - 2000, 1):
        origin = (1, 2, 3, sequence)
        assert received.lookup(origin) is None
        received.answered(origin, b"x", 0)
        assert received.lookup(origin) == b"x"


def test_restarted_sender_is_new_and_former_known() -> None:
    received = DuplicateFilter()
    received.answered(A, b"x", 0)
    again = (*A[:3], A[3] + 5 * FAR)
    assert received.lookup(again) is None
    received.answered(again, b"y", 1)
    assert (received.lookup(A), received.lookup(again)) == (b"x", b"y")


def test_flood_costs_its_own_sender_memory_of_oldest() -> None:
    received = DuplicateFilter(spans=10)
    received.answered(A, b"x", 0)
    for start in range(100):
        received.answered((99, 2, 3, start * FAR), b"x", 1)
    assert received.lookup(A) == b"x"
    assert received.lookup((99, 2, 3, 99 * FAR)) == b"x"
    assert received.spans == 11


def test_most_silent_of_many_senders_is_forgotten() -> None:
    received = DuplicateFilter(senders=3)
    for sender in range(3):
        received.answered((sender, 2, 3, 4), b"x", sender)
    assert received.lookup((0, 2, 3, 4)) == b"x"
    received.answered((3, 2, 3, 4), b"x", 9)
    assert received.lookup((1, 2, 3, 4)) is None
    assert received.lookup((0, 2, 3, 4)) == b"x"


def test_entry_older_than_any_wait_is_forgotten() -> None:
    received = DuplicateFilter(hold_ns=100)
    received.answered(A, b"x", 0)
    received.answered((*A[:3], FAR), b"x", 100)
    received.answered((7, 7, 7, 7), b"x", 100)
    assert received.lookup(A) is None
    assert received.spans == 2
    received.answered((8, 8, 8, 8), b"x", 200)
    assert received.spans == 1


def test_repeated_request_is_in_work_until_answered() -> None:
    received = DuplicateFilter(answer_bytes=10)
    received.begin(A, 0)
    assert received.lookup(A) is DuplicateState.IN_WORK
    received.answered(A, bytes(20), 1)
    assert received.lookup(A) is DuplicateState.ANSWER_GONE


def test_large_answers_are_dropped_but_remembered() -> None:
    received = DuplicateFilter(answer_bytes=100)
    received.answered(A, bytes(60), 0)
    received.answered(B, bytes(60), 0)
    assert received.lookup(A) is DuplicateState.ANSWER_GONE
    assert received.lookup(B) == bytes(60)
    received.answered(C, b"y", 0)
    assert received.lookup(C) == b"y"


def test_message_expires_in_its_senders_time() -> None:
    frame = Frame(FrameKind.MESSAGE, 1, stamp_ns=1_000, extension=with_lifetime(2.0))
    assert not expired(frame, 2_000_000_000)
    assert expired(frame, 2_000_002_000)
    assert not expired(Frame(FrameKind.MESSAGE, 1), 10**18)


def test_foreign_clock_message_expires_when_sender_learned() -> None:
    ahead = Conversion("uav1", "main", 7, 1, 10**15, 0.0, 2_000_000_000, 3_000_000, 0, 0.0, 1)
    frame = Frame(FrameKind.MESSAGE, 1, sender_hw=7, stamp_ns=10**15, extension=with_lifetime(2.0))
    over_ns = 2_000_000_000
    assert not expired_here(frame, over_ns - 3_000_001, ahead)
    assert expired_here(frame, over_ns - 2_999_999, ahead)
    assert not expired_here(frame, 10**18, None), "nobody can tell"
    assert not expired_here(Frame(FrameKind.MESSAGE, 1), 10**18, ahead), "without a lifetime it has no end"


def test_uncertain_clock_costs_quarter_of_lifetime() -> None:
    vague = Conversion("uav1", "main", 7, 1, 0, 0.0, 0, 10**12, 0, 0.0, 1)
    frame = Frame(FrameKind.MESSAGE, 1, sender_hw=7, stamp_ns=0, extension=with_lifetime(2.0))
    assert not expired_here(frame, 1_499_999_999, vague)
    assert expired_here(frame, 1_500_000_001, vague)


@given(st.binary(max_size=255))
def test_any_extension_has_a_lifetime_or_none(extension: bytes) -> None:
    found = lifetime_ns(extension)
    assert found is None or 0 <= found < 2**32 * 1_000_000


@given(st.binary(max_size=200).filter(lambda b: b[:1] != b"\x01"))
def test_a_lifetime_is_found_behind_other_elements(value: bytes) -> None:
    other = bytes((9, len(value))) + value
    assert lifetime_ns(other + with_lifetime(1.5)) == 1_500_000_000
