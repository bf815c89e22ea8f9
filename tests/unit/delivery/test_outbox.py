"""The sender's side of delivery: when it sends again, and what it tells."""

import pytest

from swarmware.model.frame import Flag, Frame, FrameKind
from swarmware.transport.delivery.answer import answerable
from swarmware.transport.delivery.outbox import GRACE_NS, Action, Complete, Outbox, Transmit
from swarmware.transport.delivery.outcome import FULL, Outcome, Status
from swarmware.types.rpc import Ack

MS = 1_000_000
HERE, THERE = 1, 2


def message(sequence: int = 1, *, receiver_hw: int = HERE, kind: FrameKind = FrameKind.MESSAGE) -> Frame:
    return Frame(kind, 7, HERE, 9, receiver_hw, sequence=sequence)


def run(outbox: Outbox, until_ns: int) -> list[tuple[int, Action]]:
    """Everything the outbox does by itself, with its instants in ms."""
    seen: list[tuple[int, Action]] = []
    while (due_ns := outbox.deadline_ns()) is not None and due_ns <= until_ns:
        seen += [(due_ns // MS, action) for action in outbox.on_timer(due_ns)]
    return seen


def outcomes(actions: list[Action]) -> list[Outcome]:
    return [action.outcome for action in actions if isinstance(action, Complete)]


@pytest.mark.parametrize(
    ("receiver", "timeout_ms", "again_at_ms"),
    [
        (HERE, 2000, [50, 150, 350, 750, 1150, 1550, 1950]),
        (THERE, 2500, [300, 900, 2100]),
        (HERE, 40, []),
    ],
)
def test_unanswered_message_repeats_slower_then_expires(
    receiver: int, timeout_ms: int, again_at_ms: list[int]
) -> None:
    outbox = Outbox(HERE)
    first = outbox.on_submit(message(receiver_hw=receiver), timeout_ms * MS, 0)
    assert first == [Transmit(message(receiver_hw=receiver))]
    seen = run(outbox, 10_000 * MS)
    assert [at for at, action in seen if isinstance(action, Transmit)] == again_at_ms
    assert seen[-1][0] == timeout_ms
    (outcome,) = outcomes([action for _, action in seen])
    assert outcome.status is Status.EXPIRED
    assert len(outbox) == 0
    assert outbox.deadline_ns() is None


@pytest.mark.parametrize("status", [Status.DELIVERED, Status.REFUSED])
def test_an_answer_settles_a_message_once(status: Status) -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(), 1000 * MS, 0)
    ack = Ack(int(status), "uav1:planner#1", "because", 5)
    key = Outbox.key(message())
    assert outcomes(outbox.on_ack(key, ack, 1 * MS)) == [Outcome(status, "uav1:planner#1", "because", 5)]
    assert outbox.on_ack(key, ack, 2 * MS) == []
    assert run(outbox, 10_000 * MS) == []


def test_a_receiver_may_appear_within_the_grace_time() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(), 5000 * MS, 0)
    key = Outbox.key(message())
    assert outbox.on_ack(key, Ack(int(Status.ABSENT), "uav1"), 1 * MS) == []
    assert run(outbox, 400 * MS)
    assert outcomes(outbox.on_ack(key, Ack(int(Status.DELIVERED)), 401 * MS)) == [Outcome(Status.DELIVERED)]


def test_receiver_that_never_appears_refuses_after_grace_time() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(), 5000 * MS, 0)
    outbox.on_ack(Outbox.key(message()), Ack(int(Status.ABSENT), "uav1", "no such inbox"), 1 * MS)
    seen = run(outbox, 10_000 * MS)
    assert seen[-1] == (
        GRACE_NS // MS + 1,
        Complete(Outbox.key(message()), Outcome(Status.REFUSED, "uav1", "no such inbox")),
    )


def test_missing_way_is_reported_with_hop() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(receiver_hw=THERE), 2000 * MS, 0)
    outbox.on_ack(Outbox.key(message()), Ack(int(Status.UNREACHABLE), "uav4", "no route"), 5 * MS)
    seen = run(outbox, 10_000 * MS)
    assert seen[-1][0] == 2000
    assert outcomes([seen[-1][1]]) == [Outcome(Status.UNREACHABLE, "uav4", "no route")]


def test_a_way_that_opens_again_delivers() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(receiver_hw=THERE), 2000 * MS, 0)
    key = Outbox.key(message())
    outbox.on_ack(key, Ack(int(Status.UNREACHABLE), "uav4"), 5 * MS)
    assert run(outbox, 950 * MS)
    assert outcomes(outbox.on_ack(key, Ack(int(Status.DELIVERED), "uav2:x#1"), 960 * MS))[0].delivered


def test_message_to_full_inbox_repeats_less_often() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(receiver_hw=THERE), 2000 * MS, 0)
    outbox.on_ack(Outbox.key(message()), Ack(int(Status.UNREACHABLE), "uav4", FULL), 5 * MS)
    seen = run(outbox, 10_000 * MS)
    assert [at_ms for at_ms, _ in seen] == [300, 900, 2000]
    assert outcomes([seen[-1][1]]) == [Outcome(Status.EXPIRED, "uav4", FULL)]


def test_way_that_may_open_is_tried_steadily() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(receiver_hw=THERE), 5000 * MS, 0)
    key, sent_ms = Outbox.key(message()), [0]
    for _ in range(5):
        outbox.on_ack(key, Ack(int(Status.UNREACHABLE), "uav4"), (sent_ms[-1] + 5) * MS)
        due_ns = outbox.deadline_ns()
        assert due_ns is not None
        assert outbox.on_timer(due_ns)
        sent_ms.append(due_ns // MS)
    assert sent_ms == [0, 300, 600, 900, 1200, 1500]


def test_the_pace_follows_the_measured_round_trip() -> None:
    outbox = Outbox(HERE)
    for sequence in range(20):
        frame = message(sequence, receiver_hw=THERE)
        outbox.on_submit(frame, 5000 * MS, sequence * 1000 * MS)
        outbox.on_ack(Outbox.key(frame), Ack(0), (sequence * 1000 + 160) * MS)
    start_ms = 30_000
    outbox.on_submit(message(99, receiver_hw=THERE), 5000 * MS, start_ms * MS)
    at_ms = run(outbox, 40_000 * MS)[0][0] - start_ms
    assert 160 <= at_ms < 200


def test_answer_to_repeated_message_measures_nothing() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(1, receiver_hw=THERE), 5000 * MS, 0)
    run(outbox, 300 * MS)
    outbox.on_ack(Outbox.key(message(1)), Ack(0), 301 * MS)
    outbox.on_submit(message(2, receiver_hw=THERE), 5000 * MS, 1000 * MS)
    assert outbox.deadline_ns() == 1300 * MS


def test_request_in_work_is_answered_once() -> None:
    outbox = Outbox(HERE)
    question = message(kind=FrameKind.REQUEST)
    outbox.on_submit(question, 5000 * MS, 0)
    key = Outbox.key(question)
    assert outbox.on_ack(key, Ack(int(Status.DELIVERED)), 10 * MS) == []
    again_ms = [at for at, action in run(outbox, 2000 * MS) if isinstance(action, Transmit)]
    assert again_ms == [50, 450, 850, 1250, 1650]
    outbox.answered(key, 2001 * MS)
    assert len(outbox) == 0
    outbox.answered(key, 2002 * MS)  # a duplicate


def test_unknown_status_of_later_version_is_refusal() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(), 1000 * MS, 0)
    assert outcomes(outbox.on_ack(Outbox.key(message()), Ack(77), 1))[0].status is Status.REFUSED


def test_receiver_that_died_is_unreachable_not_refusing() -> None:
    outbox = Outbox(HERE)
    outbox.on_submit(message(), 5000 * MS, 0)
    key = Outbox.key(message())
    outbox.reached(key)
    assert run(outbox, 200 * MS)
    outbox.on_ack(key, Ack(int(Status.ABSENT), "uav1", "no such inbox"), 201 * MS)
    seen = run(outbox, 10_000 * MS)
    assert seen[-1][0] == 201 + GRACE_NS // MS, "it had the grace time to come back"
    (outcome,) = outcomes([action for _, action in seen])
    assert (outcome.status, outcome.where) == (Status.UNREACHABLE, "uav1")


def test_acknowledged_message_kind_is_answered_at_any_priority() -> None:
    asks = {kind for kind in FrameKind if answerable(Frame(kind, 1, flags=Flag.WANTS_ACK))}
    assert asks == {
        FrameKind.BOARD,
        FrameKind.MESSAGE,
        FrameKind.REQUEST,
        FrameKind.NOTIFY,
        FrameKind.EVENT,
        FrameKind.STREAM,
        FrameKind.FILE,
    }
    assert {kind for kind in FrameKind if answerable(Frame(kind, 1))} == {
        FrameKind.MESSAGE,
        FrameKind.REQUEST,
    }


def test_slow_notifications_do_not_slow_repetition_of_commands() -> None:
    outbox = Outbox(HERE)
    for sequence, kind, way_ms in ((1, FrameKind.MESSAGE, 20), (2, FrameKind.NOTIFY, 200)):
        outbox.on_submit(message(sequence, receiver_hw=THERE, kind=kind), 5000 * MS, 0)
        outbox.on_ack((9, 7, sequence), Ack(int(Status.DELIVERED)), way_ms * MS)
    outbox.on_submit(message(3, receiver_hw=THERE), 5000 * MS, 0)
    assert outbox.deadline_ns() == 100 * MS
    outbox.drop((9, 7, 3))
    outbox.on_submit(message(4, receiver_hw=THERE, kind=FrameKind.STREAM), 5000 * MS, 0)
    assert outbox.deadline_ns() == 600 * MS
