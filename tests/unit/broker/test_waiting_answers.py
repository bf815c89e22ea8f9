"""Answers without a route wait for one, a bounded time."""

import pytest

from swarmd.broker.core.frames.waiting_answers import BYTES_MAX, FRAMES_MAX, WAIT_NS, WaitingAnswers
from swarmware.model.frame import Frame, FrameKind

GCS, UAV1 = 7, 8


def answer(receiver: int, sequence: int = 0, size: int = 10, kind: FrameKind = FrameKind.ACK) -> Frame:
    return Frame(kind, 1, 2, 3, receiver, 4, sequence=sequence, payload=bytes(size))


def sequences(waiting: WaitingAnswers, *reachable: int, now_ns: int = 0) -> list[int]:
    return [one.frame.sequence for one in waiting.take(lambda hw: hw in reachable, now_ns)]


def test_waiting_answers_leave_in_order_with_route() -> None:
    waiting = WaitingAnswers()
    for number, receiver in enumerate((GCS, UAV1, GCS)):
        assert waiting.hold(answer(receiver, number), False, 0)
    assert sequences(waiting) == []
    assert sequences(waiting, GCS) == [0, 2]
    assert sequences(waiting, GCS) == []
    assert sequences(waiting, UAV1) == [1]
    assert not waiting


def test_an_answer_of_another_node_stays_one() -> None:
    waiting = WaitingAnswers()
    waiting.hold(answer(GCS), True, 0)
    assert [one.relayed for one in waiting.take(bool, 0)] == [True]


@pytest.mark.parametrize("kind", [FrameKind.MESSAGE, FrameKind.REQUEST, FrameKind.STREAM, FrameKind.RTP])
def test_repeated_or_unneeded_answer_does_not_wait(kind: FrameKind) -> None:
    assert not WaitingAnswers().hold(answer(GCS, kind=kind), False, 0)


@pytest.mark.parametrize("kind", [FrameKind.ACK, FrameKind.REPLY, FrameKind.HELLO])
def test_answers_and_checks_of_origins_wait(kind: FrameKind) -> None:
    assert WaitingAnswers().hold(answer(GCS, kind=kind), False, 0)


def test_after_some_time_the_question_has_been_repeated() -> None:
    waiting = WaitingAnswers()
    waiting.hold(answer(GCS, 0), False, 0)
    waiting.hold(answer(GCS, 1), False, 1)
    assert sequences(waiting, GCS, now_ns=WAIT_NS + 1) == [1]


def test_few_answers_wait_and_few_bytes() -> None:
    waiting = WaitingAnswers()
    for number in range(FRAMES_MAX + 3):
        waiting.hold(answer(GCS, number), False, 0)
    assert sequences(waiting, GCS) == list(range(3, FRAMES_MAX + 3))
    for number in range(5):
        waiting.hold(answer(GCS, number, BYTES_MAX // 4), False, 0)
    assert sequences(waiting, GCS) == [1, 2, 3, 4]
