"""The receiver's side of delivery: nothing twice, the same answer each time."""

from hypothesis import given
from hypothesis import strategies as st

from swarmware.delivery import Received, Seen, expired, with_lifetime
from swarmware.delivery.answer import lifetime_ns
from swarmware.frame import Frame, Kind

A, B, C = (1, 2, 3, 4), (1, 2, 3, 5), (1, 2, 3, 6)


def test_a_repeated_message_gets_the_same_answer() -> None:
    received = Received()
    assert received.look(A) is None
    received.answered(A, b"yes", 0)
    assert received.look(A) == b"yes"
    assert received.look(B) is None
    assert received.duplicates == 1


def test_a_repeated_request_waits_for_the_one_answer() -> None:
    received = Received()
    received.begin(A, 0)
    assert received.look(A) is Seen.IN_WORK
    received.answered(A, b"42", 5)
    assert received.look(A) == b"42"


def test_the_oldest_is_forgotten_when_there_is_no_room() -> None:
    received = Received(capacity=2)
    for origin in (A, B, C):
        received.answered(origin, b"x", 0)
    assert received.look(A) is None
    assert received.look(B) == b"x"
    assert len(received) == 2


def test_what_is_older_than_any_sender_waits_is_forgotten() -> None:
    received = Received(hold_ns=100)
    received.answered(A, b"x", 0)
    received.answered(B, b"x", 100)
    assert received.look(A) is None
    assert received.look(B) == b"x"


def test_large_answers_are_dropped_but_not_the_memory_of_them() -> None:
    received = Received(answer_bytes=100)
    received.answered(A, bytes(60), 0)
    received.answered(B, bytes(60), 0)
    assert received.look(A) is Seen.ANSWER_GONE
    received.answered(C, b"y", 0)
    assert received.look(C) == b"y"


def test_a_message_is_expired_after_its_lifetime_in_its_senders_time() -> None:
    frame = Frame(Kind.MESSAGE, 1, stamp_ns=1_000, extension=with_lifetime(2.0))
    assert not expired(frame, 2_000_000_000)
    assert expired(frame, 2_000_002_000)
    assert not expired(Frame(Kind.MESSAGE, 1), 10**18)


@given(st.binary(max_size=255))
def test_any_extension_has_a_lifetime_or_none(extension: bytes) -> None:
    found = lifetime_ns(extension)
    assert found is None or 0 <= found < 2**32 * 1_000_000


@given(st.binary(max_size=200).filter(lambda b: b[:1] != b"\x01"))
def test_a_lifetime_is_found_behind_other_elements(value: bytes) -> None:
    other = bytes((9, len(value))) + value
    assert lifetime_ns(other + with_lifetime(1.5)) == 1_500_000_000
