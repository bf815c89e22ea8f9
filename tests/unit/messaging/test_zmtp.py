"""ZMTP: whatever the pieces of the stream, the same messages come out, and nothing but a WireError."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.model.frame import FRAME_LIMIT
from swarmware.transport.messaging.zmtp import DEALER, ROUTER, ZmtpConnection, message

READY = b"\x05READY\x0bSocket-Type\0\0\0\x06DEALER\x08Identity\0\0\0\0"
GREETING = b"\xff" + bytes(8) + b"\x7f\3\1NULL" + bytes(48)
OPENING = GREETING + bytes((4, len(READY))) + READY


def opened() -> ZmtpConnection:
    """A ROUTER whose peer has sent its READY."""
    made = ZmtpConnection(ROUTER)
    made.take_output()
    assert made.receive(OPENING) == []
    made.take_output()
    return made


def test_two_ends_meet() -> None:
    router, dealer = ZmtpConnection(ROUTER), ZmtpConnection(DEALER)
    for _ in range(3):
        assert router.receive(dealer.take_output() or b"") == [] if dealer.has_output else True
        assert dealer.receive(router.take_output()) == [] if router.has_output else True
    assert router.is_ready
    assert dealer.is_ready
    assert router.receive(message(b"question")) == [b"question"]


def test_greeting_and_ready_are_those_of_protocol_page() -> None:
    dealer = ZmtpConnection(DEALER)
    assert dealer.take_output() == GREETING
    dealer.receive(GREETING)
    assert dealer.take_output() == bytes((4, len(READY))) + READY


@given(st.lists(st.binary(max_size=600), max_size=5), st.lists(st.integers(1, 700)))
def test_stream_in_any_pieces_gives_same_messages(sent: list[bytes], cuts: list[int]) -> None:
    stream = OPENING + b"".join(map(message, sent))
    router = ZmtpConnection(ROUTER)
    received: list[bytes] = []
    while stream:
        cut = cuts.pop() if cuts else len(stream)
        received += router.receive(stream[:cut])
        stream = stream[cut:]
    assert received == sent


@given(st.lists(st.binary(min_size=1, max_size=80), max_size=8), st.booleans())
def test_garbage_is_a_wire_error_or_nothing(pieces: list[bytes], ready: bool) -> None:
    connection = opened() if ready else ZmtpConnection(ROUTER)
    try:
        for piece in pieces:
            assert all(isinstance(one, bytes) for one in connection.receive(piece))
    except WireError:
        pass


@pytest.mark.parametrize(
    ("stream", "words"),
    [
        (b"GET / HTTP/1.1", "greeting starts with"),
        (GREETING[:10] + b"\1" + bytes(53), "ZMTP version 1"),
        (GREETING[:12] + b"CURVE" + bytes(47), "mechanism b'CURVE'"),
        (GREETING + message(b"x"), "before READY"),
        (GREETING + b"\4\5\4PING", "expected READY"),
        (GREETING + b"\4\6\5READY", "not compatible with ROUTER"),
        (GREETING + b"\4\x0c\5READY\5abc\0\0", "ends behind"),
        (GREETING + b"\4\0", "without a name"),
        (OPENING + b"\x80\1x", "flags 0x80"),
        (OPENING + b"\5\1x", "flags 0x05"),
        (OPENING + b"\2" + (FRAME_LIMIT + 1).to_bytes(8, "big"), "expected at most"),
        (OPENING + b"\2" + b"\xff" * 8, "expected at most"),
        (OPENING + b"\6" + (5000).to_bytes(8, "big"), "a part of 5000 bytes"),
    ],
)
def test_what_breaks_the_protocol_is_named(stream: bytes, words: str) -> None:
    with pytest.raises(WireError, match=words):
        ZmtpConnection(ROUTER).receive(stream)


def test_multipart_message_is_skipped_whole() -> None:
    connection = opened()
    parts = b"\1\1a\1\1b\0\1c"
    assert connection.receive(parts + message(b"good")) == [b"good"]
    assert connection.ignored == 1


def test_ping_is_answered_and_other_commands_ignored() -> None:
    connection = opened()
    assert connection.receive(b"\4\x0a\4PING\0\1abc\4\5\4WHAT") == []
    assert connection.take_output() == b"\4\x08\4PONGabc"


def test_incoming_long_message_states_missing_bytes() -> None:
    connection = opened()
    data = message(bytes(100_000))
    assert connection.receive(data[:20_000]) == []
    assert connection.missing == len(data) - 20_000
    assert connection.receive(data[20_000:]) == [bytes(100_000)]
    assert connection.missing == 0
