"""Relayed frames: the origin signs, the receiver verifies; nobody speaks for another or repeats a frame."""

import random
from typing import Final

import msgspec
import pytest

from swarmd.broker.core.frames.end_to_end import EndToEnd, Incoming
from swarmd.broker.core.frames.frame_datagram import FRAME_MAX, pack
from swarmd.broker.core.frames.reliable.outgoing import OutgoingMessages
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.membership.origins import (
    ANSWER_NS,
    FRAME_AGE_NS,
    HELD_MAX,
    QUESTION_NS,
    RENEWAL_NS,
    Freshness,
    Origins,
    answer_to,
    is_check,
)
from swarmware.model.frame import Codec, Flag, Frame, FrameKind, decode, encode
from swarmware.model.names import hardware_id
from swarmware.transport.delivery.answer import answer, with_lifetime
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.signature import split, with_node
from swarmware.transport.sodium import SigningKey
from swarmware.types.traffic import Refused

SECOND: Final = 1_000_000_000
MEMBERS: Final = {name: SigningKey(name.encode().ljust(32)) for name in ("gcs", "uav1", "uav2")}
NAMES: Final = {hardware_id(name): name for name in MEMBERS}
GCS, UAV1, UAV2 = NAMES


class Member:
    """A node with keys, and what its broker refused."""

    is_open = False

    def __init__(self, name: str, session: int = 1000) -> None:
        self.hw = hardware_id(name)
        self.key = MEMBERS[name]
        self.refused = Refused()
        self.start(session)

    def start(self, session: int) -> None:
        self.end = EndToEnd(self.hw, session, self, lambda hw: NAMES.get(hw, "?"), self.refused)

    def sign(self, data: bytes) -> bytes:
        return self.key.sign(data)

    def sign_public_of(self, platform: str) -> bytes | None:
        return MEMBERS[platform].public if platform in MEMBERS else None

    def message(self, to: int, stamp_ns: int, *, sequence: int = 1, life_s: float | None = 2.0) -> Frame:
        extension = b"" if life_s is None else with_lifetime(life_s)
        frame = Frame(
            FrameKind.MESSAGE, 5, self.hw, 1, to, 2, sequence, stamp_ns, extension=extension, payload=b"go"
        )
        return self.end.signed(frame, UAV2)

    def take(self, frame: Frame, now_ns: int, link_hw: int = UAV2) -> Incoming:
        """The frame as it arrives over uav2."""
        arriving = decode(encode(frame))
        arriving.extension = with_node(arriving.extension, UAV2)
        return self.end.on_frame(arriving, link_hw, True, now_ns)


@pytest.fixture
def gcs() -> Member:
    return Member("gcs")


@pytest.fixture
def uav1() -> Member:
    return Member("uav1")


def confirm(receiver: Member, origin: Member, origin_ns: int, now_ns: int) -> None:
    """The question and answer about the origin's session."""
    [question] = receiver.take(origin.message(receiver.hw, origin_ns), now_ns).outgoing
    [reply, *_] = origin.take(receiver.end.signed(question, UAV2), origin_ns).outgoing
    assert len(receiver.take(origin.end.signed(reply, UAV2), now_ns).arrivals) == 1


def test_only_forwarded_frame_is_signed(gcs: Member) -> None:
    frame = Frame(FrameKind.MESSAGE, 5, GCS, 1, UAV1, 2, payload=b"go")
    assert gcs.end.signed(frame, UAV1) is frame
    assert split(gcs.end.signed(frame, UAV2).extension).signature is not None
    assert frame.extension == b"", "a retransmission starts from the frame of the application"


def test_frame_over_link_of_sender_needs_no_signature(uav1: Member) -> None:
    frame = Frame(FrameKind.MESSAGE, 5, UAV2, 1, UAV1, 2, payload=b"go")
    [arrival] = uav1.end.on_frame(frame, UAV2, True, 0).arrivals
    assert arrival.path == ()


def test_first_relayed_frame_waits_for_origins_answer(gcs: Member, uav1: Member) -> None:
    first = uav1.take(gcs.message(UAV1, 5 * SECOND), 100 * SECOND)
    assert first.arrivals == ()
    [question] = first.outgoing
    answered = gcs.take(uav1.end.signed(question, UAV2), 5 * SECOND)
    assert [frame.receiver_hw for frame in answered.outgoing] == [UAV1, UAV1], "its answer, and its question"
    released = uav1.take(gcs.end.signed(answered.outgoing[0], UAV2), 100 * SECOND + 1)
    assert [arrival.frame.payload for arrival in released.arrivals] == [b"go"]
    assert released.arrivals[0].path == (UAV2,)
    [arrival] = uav1.take(gcs.message(UAV1, 6 * SECOND, sequence=2), 101 * SECOND).arrivals
    assert arrival.frame.extension == with_lifetime(2.0)
    assert uav1.refused == Refused()


def test_path_ends_with_node_that_really_sent_it(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    frame = gcs.message(UAV1, 6 * SECOND, sequence=2)
    frame.extension = with_node(frame.extension, GCS)  # uav2 claims that another one sent it
    [arrival] = uav1.end.on_frame(frame, UAV2, True, 6 * SECOND).arrivals
    assert arrival.path == (GCS, UAV2)


def test_thousand_forged_frames_are_refused_and_counted(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    chance = random.Random(1)
    liar = Member("uav2")
    for number in range(1000):
        genuine = gcs.message(UAV1, 6 * SECOND, sequence=number + 10)
        frame = msgspec.structs.replace(genuine)
        match number % 4:
            case 0:
                frame.extension = with_lifetime(2.0)
            case 1:
                frame.payload = chance.randbytes(20)
            case 2:
                own = msgspec.structs.replace(frame, extension=with_lifetime(2.0), payload=b"mine")
                frame = liar.end.signed(own, GCS)
            case _:
                at = len(frame.extension) - 1 - chance.randrange(64)
                broken = bytearray(frame.extension)
                broken[at] ^= 1 << chance.randrange(8)
                frame.extension = bytes(broken)
        incoming = uav1.take(frame, 6 * SECOND)
        assert incoming.arrivals == ()
        assert "gcs" in incoming.refusal
    assert (uav1.refused.unsigned, uav1.refused.spoofed) == (250, 750)


def test_forwarder_may_only_report_unreachable_receiver(uav1: Member) -> None:
    relay = Member("uav2")
    asked = Frame(FrameKind.MESSAGE, 5, UAV1, 1, GCS, 2)
    for status in Status:
        refusal = answer(asked, status, where="uav2", stamp_ns=1)
        incoming = uav1.take(relay.end.signed(refusal, UAV1), SECOND)
        assert bool(incoming.arrivals) is (status is Status.UNREACHABLE)
    assert uav1.refused.spoofed == len(Status) - 1


def test_recorded_frame_is_refused_after_its_lifetime(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 100 * SECOND)
    for life_s, age_ns in ((2.0, 2 * SECOND), (None, FRAME_AGE_NS)):
        recorded = gcs.message(UAV1, 6 * SECOND, sequence=2, life_s=life_s)
        assert uav1.take(recorded, 101 * SECOND).arrivals
        assert uav1.take(recorded, 101 * SECOND + age_ns // 2).arrivals, "a retransmission"
        for number in range(1000):
            late_ns = 101 * SECOND + age_ns + age_ns // 100 + number * 7 * SECOND
            assert not uav1.take(recorded, late_ns).arrivals
    assert uav1.refused.replayed == 2000


def test_recorded_frame_is_refused_after_both_restarted(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    recorded = gcs.message(UAV1, 6 * SECOND, sequence=2)
    gcs.start(2000)
    uav1.start(2000)
    assert not uav1.take(recorded, 6 * SECOND).arrivals, "its session is not confirmed"
    confirm(uav1, gcs, 7 * SECOND, 7 * SECOND + QUESTION_NS)
    assert not uav1.take(recorded, 7 * SECOND + QUESTION_NS).arrivals
    assert uav1.refused.replayed == 1


def test_a_recorded_answer_confirms_nothing(gcs: Member, uav1: Member) -> None:
    [question] = uav1.take(gcs.message(UAV1, 5 * SECOND), 5 * SECOND).outgoing
    [reply, _] = gcs.take(uav1.end.signed(question, UAV2), 5 * SECOND).outgoing
    recorded = gcs.end.signed(reply, UAV2)
    assert uav1.take(recorded, 5 * SECOND).arrivals
    assert not uav1.take(recorded, 5 * SECOND).arrivals
    uav1.start(2000)
    uav1.take(gcs.message(UAV1, 6 * SECOND, sequence=2), 6 * SECOND)
    assert not uav1.take(recorded, 6 * SECOND).arrivals
    other = Member("uav2")
    forged = msgspec.structs.replace(reply, extension=b"")
    assert not uav1.take(other.end.signed(forged, UAV1), 6 * SECOND).arrivals


def test_origin_with_stopped_clock_is_asked_again(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    refused = uav1.take(gcs.message(UAV1, 6 * SECOND, sequence=2), 3600 * SECOND)
    assert "made long ago" in refused.refusal
    [question] = refused.outgoing
    [reply] = gcs.take(uav1.end.signed(question, UAV2), 6 * SECOND).outgoing[:1]
    uav1.take(gcs.end.signed(reply, UAV2), 3600 * SECOND)
    assert uav1.take(gcs.message(UAV1, 7 * SECOND, sequence=3), 3601 * SECOND).arrivals


def test_a_member_that_is_revoked_signs_in_vain(
    gcs: Member, uav1: Member, monkeypatch: pytest.MonkeyPatch
) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    frame = gcs.message(UAV1, 6 * SECOND, sequence=2)
    monkeypatch.delitem(MEMBERS, "gcs")
    assert not uav1.take(frame, 6 * SECOND).arrivals
    assert uav1.refused.spoofed == 1


def test_urgent_order_is_compressed_before_signing(gcs: Member, uav1: Member) -> None:
    confirm(uav1, gcs, 5 * SECOND, 5 * SECOND)
    frame = Frame(
        FrameKind.REQUEST, 5, GCS, 1, UAV1, 2, 9, 6 * SECOND, flags=Flag.URGENT, payload=b"order " * 400
    )
    signed = gcs.end.signed(frame, UAV2)
    assert signed.codec is Codec.ZLIB
    data = pack(signed)
    assert data is not None
    forwarded = decode(data)
    forwarded.extension = with_node(forwarded.extension, UAV2)
    again = pack(forwarded)
    assert again is not None
    assert len(again) <= FRAME_MAX
    assert uav1.end.on_frame(decode(again), UAV2, True, 6 * SECOND).arrivals


def test_oversized_signed_frame_is_forwarded_unchanged(gcs: Member) -> None:
    frame = Frame(FrameKind.REQUEST, 5, GCS, 1, UAV1, 2, payload=b"order " * 400)
    signed = gcs.end.signed(frame, UAV2)
    signed.flags = Flag.URGENT
    assert pack(signed) is None


def test_answer_and_question_are_two_frames(gcs: Member, uav1: Member) -> None:
    frame = gcs.message(UAV1, SECOND)
    [question] = uav1.take(frame, SECOND).outgoing
    sent = gcs.take(uav1.end.signed(question, UAV2), SECOND).outgoing
    assert len(sent) == 2, "it answers, and asks for itself"
    queue = OutgoingMessages()
    for own in sent:
        signed = gcs.end.signed(own, UAV2)
        queue.put(QueuedFrame(encode(signed), signed, SECOND))
    assert queue.waiting == 2, "a copy of a frame that is in flight is dropped"


def test_questions_are_few_and_waiting_frames_are_bounded() -> None:
    origins: Origins[int] = Origins(7)
    question = origins.question(1, 0)
    assert question is not None
    assert is_check(question)
    assert origins.question(1, QUESTION_NS - 1) is None
    assert origins.question(1, QUESTION_NS) == question, "the answer to an earlier one counts"
    assert origins.question(1, ANSWER_NS + 1) != question
    for item in range(HELD_MAX + 5):
        origins.hold(1, 50, item)
    latest = origins.question(1, 2 * ANSWER_NS + 2)
    assert latest is not None
    reply = answer_to(latest)
    assert reply is not None
    assert origins.on_answer(1, 50, reply, 0, 2 * ANSWER_NS + 2) == list(range(5, HELD_MAX + 5))
    assert answer_to(reply) is None


def test_clock_unseen_for_hour_is_asked_again() -> None:
    origins: Origins[int] = Origins(7)
    question = origins.question(1, 0)
    assert question is not None
    reply = answer_to(question)
    assert reply is not None
    origins.on_answer(1, 50, reply, 0, 0)
    slow_ns = RENEWAL_NS - 10 * SECOND
    assert origins.judge(1, 50, slow_ns, 60 * SECOND, RENEWAL_NS) is Freshness.CURRENT
    assert origins.judge(1, 50, slow_ns, 60 * SECOND, RENEWAL_NS + 1) is Freshness.UNKNOWN


@pytest.mark.parametrize("payload", [b"", bytes(8), bytes(13), b"\x03" + bytes(12), b"\x01" + bytes(13)])
def test_other_bytes_are_no_check(payload: bytes) -> None:
    assert not is_check(payload)


def test_frame_expiring_during_wait_is_refused_and_counted(gcs: Member, uav1: Member) -> None:
    [question] = uav1.take(gcs.message(UAV1, 5 * SECOND, life_s=0.1), 100 * SECOND).outgoing
    [reply, *_] = gcs.take(uav1.end.signed(question, UAV2), 6 * SECOND).outgoing
    late = uav1.take(gcs.end.signed(reply, UAV2), 101 * SECOND)
    assert late.arrivals == ()
    assert uav1.refused.replayed == 1


def test_without_keys_frames_are_neither_signed_nor_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Member, "is_open", True)
    gcs, uav1 = Member("gcs"), Member("uav1")
    frame = gcs.message(UAV1, SECOND)
    assert split(frame.extension).signature is None
    [arrival] = uav1.end.on_frame(decode(encode(frame)), None, True, SECOND).arrivals
    assert arrival.path == ()


def test_question_of_other_bytes_is_counted_as_malformed(gcs: Member, uav1: Member) -> None:
    question = Frame(FrameKind.HELLO, 0, gcs.hw, 0, UAV1, 0, 1, SECOND, payload=b"?")
    assert uav1.take(gcs.end.signed(question, UAV2), SECOND) == Incoming()
    assert uav1.refused.malformed == 1
