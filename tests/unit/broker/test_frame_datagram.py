"""Frames as datagrams: which go so, their header, their seal, and what becomes of lost ones."""

import contextlib
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.frames.frame_datagram import (
    BURST,
    BURST_NS,
    FRAME,
    FRAME_MAX,
    HEADER_BYTES,
    MISSES,
    PACKET,
    RETRY_NS,
    DatagramPaths,
    decode_header,
    encode_header,
    may_begin,
    pack,
)
from swarmd.broker.sockets.pair_seal import PAIR_WINDOW, PairEnd, PairSeal
from swarmware.errors import WireError
from swarmware.model.frame import Codec, Flag, Frame, FrameKind, decode, encode
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import Opened, Refusal
from swarmware.transport.sodium import TAG_BYTES
from swarmware.types import registry
from swarmware.types.scalar import Text

S = 1_000_000_000
URGENT = Flag.URGENT


def request(text: str, flags: int = URGENT) -> Frame:
    return Frame(FrameKind.REQUEST, 7, 1, 2, 3, flags=flags, payload=registry.encode(Text(text)))


def test_small_urgent_frame_is_packed_as_it_is() -> None:
    frame = request("land")
    data = pack(frame)
    assert data is not None
    assert decode(data) == frame


def test_a_larger_one_is_compressed_and_says_so() -> None:
    data = pack(request("go " * 1000))
    assert data is not None
    assert len(data) <= FRAME_MAX
    packed = decode(data)
    assert packed.codec is Codec.ZLIB
    assert registry.decode(Text, packed.payload, packed.codec) == Text("go " * 1000)


@pytest.mark.parametrize(
    "frame",
    [
        request(Random(1).randbytes(FRAME_MAX).hex()),
        request("x" * 1_000_000),
        request("go " * 1000, flags=0),
    ],
    ids=["too large", "too large to try", "to be compressed, and not urgent"],
)
def test_large_frames_take_the_connection(frame: Frame) -> None:
    assert pack(frame) is None


def test_unchanged_frame_is_packed_as_received() -> None:
    frame = request("land", flags=0)
    data = encode(frame)
    assert pack(frame, data) is data
    frame.hops_left -= 1
    again = pack(frame, data)
    assert again is not None
    assert decode(again) == frame


@pytest.mark.parametrize("kind", FrameKind)
def test_repeated_or_urgent_frame_may_begin_as_datagram(
    kind: FrameKind,
) -> None:
    questions = {FrameKind.MESSAGE, FrameKind.REQUEST, FrameKind.ACK, FrameKind.REPLY}
    assert may_begin(Frame(kind, 7, flags=Flag.URGENT))
    assert may_begin(Frame(kind, 7, flags=Flag.WANTS_ACK)) is (kind in questions)
    assert not may_begin(Frame(kind, 7, flags=Flag.BULK))
    assert not may_begin(Frame(kind, 7, payload=bytes(FRAME_MAX + 1)))


def test_a_datagram_is_never_longer_than_a_beacon() -> None:
    assert HEADER_BYTES + FRAME_MAX + TAG_BYTES == 1238


def test_the_header_comes_back() -> None:
    for content in (FRAME, PACKET):
        header = encode_header(content, 0xB77A24A2, 1000)
        assert decode_header(header + b"sealed") == (content, 0xB77A24A2, 1000)


@given(st.binary(max_size=40))
def test_any_bytes_are_header_or_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        decode_header(data)


def test_foreign_or_empty_header_is_refused() -> None:
    clear = encode_header(FRAME, 1, 1)
    for data in (b"", clear, bytes((clear[0], 9)) + clear[2:] + b"x", b"\x54" + clear[1:] + b"x"):
        with pytest.raises(WireError, match="datagram"):
            decode_header(data)


class Pair:
    """The seals of two nodes for each other."""

    def __init__(self, session: int = 10, peer_session: int = 20) -> None:
        self.keys, self.peer_keys = KEYS
        self.own = PairEnd(1, session, self.keys.curve_public)
        self.peer = PairEnd(2, peer_session, self.peer_keys.curve_public)
        self.here = PairSeal(self.keys.curve_secret, self.own, self.peer)
        self.there = PairSeal(self.peer_keys.curve_secret, self.peer, self.own)


KEYS = (Keys.open("uav1"), Keys.open("uav2"))
CLEAR = encode_header(FRAME, 1, 5)


def test_what_one_seals_the_other_opens_once() -> None:
    pair = Pair()
    box = pair.here.seal(5, CLEAR, b"land")
    assert pair.there.open(5, CLEAR, box) == Opened(b"land", 10)
    assert pair.there.open(5, CLEAR, box) is Refusal.REPLAYED


def test_datagrams_may_overtake_each_other() -> None:
    pair = Pair()
    boxes = {number: pair.here.seal(number, CLEAR, bytes((number,))) for number in (1, 2, 3, 90)}
    for number in (2, 1, 90, 3):
        assert pair.there.open(number, CLEAR, boxes[number]) == Opened(bytes((number,)), 10)
    for number in (3, 90):
        assert pair.there.open(number, CLEAR, boxes[number]) is Refusal.REPLAYED


def test_datagrams_to_others_keep_late_one_valid() -> None:
    pair = Pair()
    newest = PAIR_WINDOW + 3
    pair.there.open(newest, CLEAR, pair.here.seal(newest, CLEAR, b"now"))
    assert pair.there.open(4, CLEAR, pair.here.seal(4, CLEAR, b"late")) == Opened(b"late", 10)
    assert pair.there.open(3, CLEAR, pair.here.seal(3, CLEAR, b"too late")) is Refusal.REPLAYED


@pytest.mark.parametrize("at", [0, 3, -1])
def test_changed_datagram_is_forged_and_genuine_taken(at: int) -> None:
    pair = Pair()
    box = bytearray(pair.here.seal(5, CLEAR, b"land"))
    genuine = bytes(box)
    box[at] ^= 1
    assert pair.there.open(5, CLEAR, bytes(box)) is Refusal.FORGED
    assert pair.there.open(5, encode_header(FRAME, 1, 6), genuine) is Refusal.FORGED, (
        "the header is sealed, too"
    )
    assert pair.there.open(5, CLEAR, genuine) == Opened(b"land", 10)


def test_datagram_of_former_session_is_forged() -> None:
    box = Pair().here.seal(5, CLEAR, b"land")
    assert Pair(session=11).there.open(5, CLEAR, box) is Refusal.FORGED
    assert Pair(peer_session=21).there.open(5, CLEAR, box) is Refusal.FORGED


def test_datagram_is_not_accepted_back_from_receiver() -> None:
    pair = Pair()
    assert pair.here.open(5, CLEAR, pair.here.seal(5, CLEAR, b"land")) is Refusal.FORGED


def test_third_member_can_neither_open_nor_make_one() -> None:
    pair, third = Pair(), Keys.open("uav3")
    box = pair.here.seal(5, CLEAR, b"land")
    assert PairSeal(third.curve_secret, pair.peer, pair.own).open(5, CLEAR, box) is Refusal.FORGED
    forged = PairSeal(third.curve_secret, pair.own, pair.peer).seal(5, CLEAR, b"land")
    assert pair.there.open(5, CLEAR, forged) is Refusal.FORGED


def test_a_key_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="low order"):
        PairSeal(KEYS[0].curve_secret, Pair().own, PairEnd(2, 20, bytes(32)))


def lose(paths: DatagramPaths, hw: int, now_ns: int) -> None:
    paths.on_sent(hw, now_ns)
    paths.on_repeated(hw, now_ns)
    paths.on_repeated(hw, now_ns)


def test_neighbour_gets_datagrams_until_none_arrives() -> None:
    paths = DatagramPaths()
    for count in range(MISSES):
        assert paths.may_send(1, count), "one loss is an accident, however often its frame is repeated"
        lose(paths, 1, count)
    assert not paths.may_send(1, MISSES)
    assert paths.may_send(2, MISSES), "other neighbours keep theirs"


def test_answered_datagram_keeps_path_open() -> None:
    paths = DatagramPaths()
    for _ in range(MISSES + 2):
        lose(paths, 1, 0)
        paths.on_sent(1, 0)
        assert paths.may_send(1, 0)


def test_repetitions_over_connection_do_not_judge_path() -> None:
    paths = DatagramPaths()
    for _ in range(MISSES):
        paths.on_repeated(1, 0)
    assert paths.may_send(1, 0)


def test_a_closed_path_is_tried_again_later() -> None:
    paths = DatagramPaths()
    for at_ns in (0, S):
        lose(paths, 1, at_ns)
    assert not paths.may_send(1, S + RETRY_NS - 1)
    assert paths.may_send(1, S + RETRY_NS)
    lose(paths, 1, S + RETRY_NS)
    assert paths.may_send(1, S + RETRY_NS), "it is counted from the beginning"


def test_burst_to_one_neighbour_is_limited() -> None:
    paths = DatagramPaths(BURST)
    for _ in range(BURST):
        assert paths.may_send(1, S)
        paths.on_sent(1, S)
    assert not paths.may_send(1, S)
    assert not paths.may_send(1, S + BURST_NS - 1)
    assert paths.may_send(2, S), "other neighbours have their own"
    assert paths.may_send(1, S + BURST_NS)
    paths.on_sent(1, S + BURST_NS)
    assert paths.may_send(1, S + BURST_NS), "it is counted from the beginning"


def test_urgent_paths_have_no_burst_limit() -> None:
    paths = DatagramPaths()
    for _ in range(2 * BURST):
        paths.on_sent(1, S)
    assert paths.may_send(1, S)
