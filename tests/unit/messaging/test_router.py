"""The message router as a table: each decision, and that no frame makes it raise or loop."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.messaging.frames import any_frames
from tests.unit.messaging.routing import (
    BROKER,
    ELSEWHERE,
    HERE,
    LEFT_APP,
    MESSAGES,
    NOWHERE,
    OTHER,
    OTHER_APP,
    OWN,
    OWN_APP,
    REQUESTS,
    THERE,
    VIA,
    S,
    make_router,
)

from swarmware.model.frame import PAYLOAD_LIMIT, Flag, Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.transport.delivery.answer import reply, with_lifetime
from swarmware.transport.delivery.outbox import GRACE_NS, WINDOW, Complete
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.messaging.router import (
    PROBE_NS,
    Action,
    Arrive,
    Deliver,
    Drop,
    HandOver,
    KeepConnections,
    MessageRouter,
    Probe,
    Refuse,
    Repeat,
    Replied,
    SendBack,
    Settle,
    Takes,
    ToGateway,
    ToProcess,
)
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply
from swarmware.types.system import MessageCounters


def question(
    data: int, to: int = HERE, app: int = ANY, kind: FrameKind = FrameKind.MESSAGE, sequence: int = 1
) -> Frame:
    return Frame(kind, data, HERE, OWN_APP, to, app, sequence, flags=Flag.WANTS_ACK)


def from_afar(data: int, kind: FrameKind = FrameKind.MESSAGE, *, age_ns: int = 0, sequence: int = 1) -> Frame:
    """A message of uav7 with a lifetime of two seconds, which our clock sees at zero plus its age."""
    frame = question(data, kind=kind, sequence=sequence)
    frame.sender_hw, frame.sender_app, frame.stamp_ns = THERE, 9, 10 * S - age_ns
    frame.extension = with_lifetime(2.0)
    return frame


def ack_of(frame: Frame) -> tuple[int, str, str]:
    ack = registry.decode(Ack, frame.payload)
    return ack.status, ack.where, ack.detail


def only(actions: list[Action]) -> Action:
    (action,) = actions
    return action


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        # an answer, by its application
        (Frame(FrameKind.ACK, MESSAGES, receiver_hw=HERE, receiver_app=OWN_APP), Settle),
        (Frame(FrameKind.REPLY, MESSAGES, receiver_hw=ANY, receiver_app=OWN_APP), Settle),
        (Frame(FrameKind.ACK, MESSAGES, receiver_hw=HERE, receiver_app=OTHER_APP), OTHER),
        (Frame(FrameKind.ACK, MESSAGES, receiver_hw=HERE, receiver_app=LEFT_APP), "unclaimed_answers"),
        (Frame(FrameKind.REPLY, MESSAGES, receiver_hw=HERE, receiver_app=ANY), "unclaimed_answers"),
        # a message or request, by its data id or application
        (question(MESSAGES), Deliver),
        (question(MESSAGES, ANY), Deliver),
        (question(MESSAGES, app=OWN_APP), Deliver),
        (question(REQUESTS, kind=FrameKind.REQUEST), Deliver),
        (question(MESSAGES, app=OTHER_APP), OTHER),
        (question(ELSEWHERE), OTHER),
        (question(ELSEWHERE, app=OTHER_APP), OTHER),
        (question(ELSEWHERE, app=OWN_APP), Status.ABSENT),
        (question(ELSEWHERE, app=LEFT_APP), Status.ABSENT),
        (question(NOWHERE), Status.ABSENT),
        (question(NOWHERE, app=OWN_APP), Status.ABSENT),
        # what asks for no answer
        (Frame(FrameKind.BOARD, MESSAGES, receiver_hw=HERE), "unanswerable"),
        (Frame(FrameKind.NOTIFY, MESSAGES, receiver_hw=HERE), "unanswerable"),
        (Frame(FrameKind.HELLO, MESSAGES, receiver_hw=ANY), "unanswerable"),
        # another platform
        (question(MESSAGES, THERE), BROKER),
        (question(MESSAGES, 0), BROKER),
        (Frame(FrameKind.ACK, MESSAGES, receiver_hw=THERE, receiver_app=OWN_APP), BROKER),
    ],
)
def test_where_a_frame_goes(frame: Frame, expected: object) -> None:
    router = make_router()
    decision = router.route(frame)
    match decision:
        case ToProcess(address, sent):
            assert (address, sent) == (expected, frame)
            assert router.process_of(frame) == address
        case Refuse(refused, status, _):
            assert (status, refused) == (expected, frame)
        case Drop(counter):
            assert counter == expected
        case _:
            assert (type(decision), decision.frame) == (expected, frame)


@pytest.mark.parametrize(
    ("frame", "gateway", "expected"),
    [
        (question(MESSAGES), False, False),
        (question(MESSAGES, ANY), False, False),
        (question(MESSAGES, app=OTHER_APP), False, True),
        (question(ELSEWHERE), False, True),
        (question(MESSAGES, THERE), False, True),
        (question(MESSAGES, THERE), True, False),
        (Frame(FrameKind.ACK, MESSAGES, receiver_hw=HERE, receiver_app=OWN_APP), False, False),
        (Frame(FrameKind.REPLY, MESSAGES, receiver_hw=HERE, receiver_app=OTHER_APP), False, True),
    ],
)
def test_applications_are_reread_only_where_decisive(frame: Frame, gateway: bool, expected: bool) -> None:
    router = make_router(gateway=gateway)
    assert router.needs_applications(frame) is expected
    before = router.route(frame)
    router.on_applications({}, {}, None, 0)
    assert expected or router.route(frame) == before


@pytest.mark.parametrize("broker", [None, OWN])
def test_messages_elsewhere_are_refused_without_broker(
    broker: str | None,
) -> None:
    router = make_router(broker=broker)
    refusal = router.route(question(MESSAGES, THERE))
    assert isinstance(refusal, Refuse)
    assert (refusal.status, refusal.detail) == (Status.UNREACHABLE, "no broker runs here")
    answer = Frame(FrameKind.ACK, MESSAGES, receiver_hw=THERE)
    assert router.route(answer) == Drop("unclaimed_answers")


def test_gateway_gets_all_messages_for_other_platforms() -> None:
    router = make_router(gateway=True)
    for frame in (question(MESSAGES, THERE), Frame(FrameKind.REPLY, 1, receiver_hw=THERE)):
        assert router.route(frame) == ToGateway(frame)
        assert router.on_frame(frame, VIA, 0) == [ToGateway(frame)]


def test_own_frame_arrives_later_and_foreign_at_once() -> None:
    router = make_router()
    frame = question(MESSAGES)
    assert router.on_message(frame, S, 0) == [Arrive(frame)]
    assert router.on_frame(frame, None, 0) == [Arrive(frame)]
    assert router.on_frame(frame, VIA, 0) == [HandOver(frame, VIA, Takes.MESSAGES)]


def test_refusal_returns_by_connection_or_table() -> None:
    router = make_router()
    frame = from_afar(NOWHERE)
    by_connection = only(router.on_frame(frame, VIA, 0))
    assert isinstance(by_connection, SendBack)
    assert by_connection.via == VIA
    assert ack_of(by_connection.frame) == (
        Status.ABSENT,
        "uav1",
        "no application here takes this path and type",
    )
    by_table = only(router.on_frame(frame, None, 0))
    assert isinstance(by_table, ToProcess)
    assert (by_table.address, by_table.frame.receiver_hw) == (BROKER, THERE)
    closed = only(router.on_connection_closed(by_connection.frame, 0))
    assert closed == ToProcess(BROKER, by_connection.frame)


def test_message_is_delivered_once_and_answered_alike() -> None:
    router = make_router()
    frame = from_afar(MESSAGES)
    assert router.on_arrival(frame, VIA, 0) == [HandOver(frame, VIA, Takes.MESSAGES)]
    first = only(router.on_outcome(frame, VIA, Outcome(Status.DELIVERED, "uav1:app", received_ns=3), 1))
    assert isinstance(first, SendBack)
    assert first.frame.sender_hw == HERE
    again = only(router.on_arrival(frame, "another", 2 * S))
    assert isinstance(again, SendBack)
    assert (again.via, again.frame.payload) == ("another", first.frame.payload)
    assert router.counters().duplicates == 1


def test_refused_message_is_delivered_on_repetition() -> None:
    router = make_router()
    frame = from_afar(MESSAGES)
    refused = Outcome(Status.REFUSED, "uav1:app", "not now")
    for outcome, status in ((None, Status.UNREACHABLE), (refused, Status.REFUSED)):
        assert router.on_arrival(frame, VIA, 0) == [HandOver(frame, VIA, Takes.MESSAGES)]
        back = only(router.on_outcome(frame, VIA, outcome, 0))
        assert isinstance(back, SendBack)
        assert registry.decode(Ack, back.frame.payload).status == status
    assert router.on_arrival(frame, VIA, 0) == [HandOver(frame, VIA, Takes.MESSAGES)]
    assert router.counters().no_room == 1


def test_request_in_work_says_so_then_repeats_reply() -> None:
    router = make_router()
    frame = from_afar(REQUESTS, FrameKind.REQUEST)
    assert router.on_arrival(frame, VIA, 0) == [HandOver(frame, VIA, Takes.REQUESTS)]
    in_work = only(router.on_arrival(frame, VIA, 1))
    assert isinstance(in_work, SendBack)
    assert (in_work.frame.kind, ack_of(in_work.frame)[0]) == (FrameKind.ACK, Status.DELIVERED)
    replied = only(router.on_handler_reply(frame, VIA, Reply(True, b"yes"), 2))
    assert only(router.on_arrival(frame, VIA, 3)) == SendBack(
        VIA, reply_to(frame, registry.encode(Reply(True, b"yes")), 3)
    )
    assert isinstance(replied, SendBack)
    assert registry.decode(Reply, replied.frame.payload).body == b"yes"


def reply_to(frame: Frame, payload: bytes, now_ns: int) -> Frame:
    back = reply(frame, FrameKind.REPLY, payload, now_ns)
    back.sender_hw = HERE
    return back


def test_reply_too_large_for_frame_is_error() -> None:
    router = make_router()
    frame = from_afar(REQUESTS, FrameKind.REQUEST)
    router.on_arrival(frame, VIA, 0)
    sent = only(router.on_handler_reply(frame, VIA, Reply(True, bytes(PAYLOAD_LIMIT)), 0))
    assert isinstance(sent, SendBack)
    replied = registry.decode(Reply, sent.frame.payload)
    assert (replied.ok, replied.kind) == (False, "OutOfRange")
    assert router.counters().oversized_answers == 1


@pytest.mark.parametrize(
    ("data", "kind", "takes"),
    [(MESSAGES, FrameKind.REQUEST, "messages"), (REQUESTS, FrameKind.MESSAGE, "requests")],
)
def test_request_to_inbox_and_message_to_server_fail(data: int, kind: FrameKind, takes: str) -> None:
    refusal = only(make_router().on_frame(from_afar(data, kind), VIA, 0))
    assert isinstance(refusal, SendBack)
    assert ack_of(refusal.frame) == (Status.REFUSED, "uav1", f"this path takes {takes} only")


def test_expired_message_is_dropped_unless_delivered_before() -> None:
    router = make_router()
    late, known = from_afar(MESSAGES, age_ns=3 * S), from_afar(MESSAGES, sequence=2)
    router.on_arrival(known, VIA, 0)
    router.on_outcome(known, VIA, Outcome(Status.DELIVERED), 0)
    assert router.on_frame(late, VIA, 0) == []
    assert router.counters().expired == 1
    assert isinstance(only(router.on_frame(known, VIA, 3 * S)), SendBack)
    unknown = from_afar(MESSAGES, age_ns=3 * S, sequence=3)
    unknown.sender_hw = 99
    assert router.on_frame(unknown, VIA, 0) == [HandOver(unknown, VIA, Takes.MESSAGES)]
    own = question(MESSAGES, sequence=4)
    own.extension = with_lifetime(2.0)
    assert router.on_arrival(own, None, 2 * S + 1) == []


def test_departed_application_leaves_paths_absent() -> None:
    router = make_router()
    frame = from_afar(MESSAGES)
    assert sorted(router.remove_application(OWN_APP)) == [MESSAGES, REQUESTS]
    gone = only(router.on_arrival(frame, VIA, 0))
    assert isinstance(gone, SendBack)
    assert ack_of(gone.frame) == (Status.ABSENT, "uav1", "the inbox was closed")
    assert router.route(frame).__class__ is Refuse
    assert router.route(reply(frame, FrameKind.ACK, b"", 0)) == ToProcess(
        BROKER, reply(frame, FrameKind.ACK, b"", 0)
    )


def test_answer_completes_its_message_and_opens_its_window() -> None:
    router = make_router()
    frames = [question(MESSAGES, THERE, sequence=n) for n in range(WINDOW + 2)]
    for frame in frames[:WINDOW]:
        assert router.on_message(frame, S, 0) == [ToProcess(BROKER, frame)]
    over = only(router.on_message(frames[WINDOW], S, 0))
    assert isinstance(over, Complete)
    assert over.outcome == Outcome(Status.REFUSED, "uav1", f"{WINDOW} messages wait for an answer")
    other_id = question(ELSEWHERE, THERE)
    assert router.on_message(other_id, S, 0) == [ToProcess(BROKER, other_id)]
    answer = reply(frames[0], FrameKind.ACK, registry.encode(Ack(0, "uav7:x")), 0)
    done = only(router.on_frame(answer, VIA, 1))
    assert done == Complete((OWN_APP, MESSAGES, 0), Outcome(Status.DELIVERED, "uav7:x"))
    assert router.on_frame(answer, VIA, 2) == [], "a second one finds nobody who waits"
    assert router.on_message(frames[WINDOW + 1], S, 2) == [ToProcess(BROKER, frames[WINDOW + 1])]


def test_cancelled_message_frees_window_without_repetition() -> None:
    router = make_router()
    for sequence in range(WINDOW):
        router.on_message(question(MESSAGES, THERE, sequence=sequence), S, 0)
    for sequence in range(WINDOW):
        router.cancel((OWN_APP, MESSAGES, sequence))
    assert router.deadline_ns() is None
    assert router.on_timer(S) == []
    frame = question(MESSAGES, THERE, sequence=WINDOW)
    assert router.on_message(frame, S, S) == [ToProcess(BROKER, frame)]


def test_reply_or_error_ends_its_request() -> None:
    router = make_router()
    asked = question(REQUESTS, THERE, kind=FrameKind.REQUEST)
    assert router.on_request(asked, S, 0) == [ToProcess(BROKER, asked)]
    answer = reply(asked, FrameKind.REPLY, registry.encode(Reply(True, b"1")), 0)
    assert router.on_frame(answer, VIA, 1) == [Replied((OWN_APP, REQUESTS, 1), Reply(True, b"1"))]
    assert router.deadline_ns() is None
    router.on_request(asked, S, 2)
    refused = reply(asked, FrameKind.ACK, registry.encode(Ack(int(Status.REFUSED), "uav7", "no")), 0)
    assert router.on_frame(refused, VIA, 3) == [
        Complete((OWN_APP, REQUESTS, 1), Outcome(Status.REFUSED, "uav7", "no"))
    ]


def test_repetition_follows_probe_and_probes_are_limited() -> None:
    router = make_router()
    frame = question(ELSEWHERE)
    assert router.on_message(frame, 5 * S, 0) == [ToProcess(OTHER, frame)]
    due_ns = router.deadline_ns()
    assert due_ns is not None
    assert router.on_timer(due_ns) == [Probe(), Repeat(frame)]
    assert router.on_applications({OWN_APP: OWN}, {}, None, 0) == [KeepConnections(frozenset({OWN}))]
    assert router.on_repeat(frame, due_ns) == []
    assert router.counters().repeated == 1
    other = question(ELSEWHERE, sequence=2)
    router.on_message(other, 5 * S, due_ns - 40_000_000)
    between_ns = router.deadline_ns()
    assert between_ns is not None and between_ns < due_ns + PROBE_NS
    assert Probe() not in router.on_timer(between_ns)


def test_dead_receiver_makes_message_unreachable() -> None:
    router = make_router()
    frame = question(ELSEWHERE)
    router.on_message(frame, 60 * S, 0)
    router.on_applications({OWN_APP: OWN}, {}, None, 0)
    outcomes: list[Action] = []
    while (due_ns := router.deadline_ns()) is not None:
        for action in router.on_timer(due_ns):
            if isinstance(action, Repeat):
                outcomes += router.on_repeat(action.frame, due_ns)
            elif isinstance(action, Complete):
                outcomes.append(action)
        assert due_ns < 3 * GRACE_NS
    done = only(outcomes)
    assert isinstance(done, Complete)
    assert (done.outcome.status, done.outcome.detail) == (
        Status.UNREACHABLE,
        "the receiver has ended without an answer",
    )


def test_denied_request_is_answered_and_message_refused() -> None:
    router = make_router()
    asked = from_afar(REQUESTS, FrameKind.REQUEST)
    denied = only(router.on_denial(asked, "role", None, 0))
    assert isinstance(denied, ToProcess)
    assert registry.decode(Reply, denied.frame.payload).kind == "Denied"
    refused = only(router.on_denial(from_afar(MESSAGES), "role", None, 0))
    assert isinstance(refused, ToProcess)
    assert ack_of(refused.frame) == (Status.REFUSED, "uav1", "role")


def test_refusing_hop_answers_in_same_pass() -> None:
    router = make_router(gateway=True)
    frame = question(MESSAGES, THERE)
    assert router.on_message(frame, S, 0) == [ToGateway(frame)]
    assert router.on_refusal(frame, (Status.REFUSED, "no"), None, 1) == [
        Complete((OWN_APP, MESSAGES, 1), Outcome(Status.REFUSED, "uav1", "no"))
    ]


frames = any_frames(
    [MESSAGES, REQUESTS, ELSEWHERE, NOWHERE], [0, 1, OWN_APP, OTHER_APP, LEFT_APP, HERE, THERE, ANY]
)
steps = st.tuples(
    st.sampled_from(["frame", "message", "request", "closed", "refused", "denied", "repeat", "arrival"]),
    frames,
    st.sampled_from([None, VIA]),
)


@given(
    st.lists(steps, max_size=40),
    st.booleans(),
    st.sampled_from([None, OWN, BROKER]),
    st.sampled_from([{}, {OWN_APP: OWN}, {OWN_APP: OTHER, OTHER_APP: OTHER}, {OTHER_APP: OWN}]),
)
def test_no_frame_makes_it_raise_or_loop(
    given_steps: list[tuple[str, Frame, str | None]],
    gateway: bool,
    broker: str | None,
    applications: dict[int, str],
) -> None:
    router = make_router(broker=broker, gateway=gateway)
    router.on_applications(applications, {ELSEWHERE: OTHER, NOWHERE: OWN}, broker, 0)
    for now_ns, (event, frame, via) in enumerate(given_steps):
        before = router.route(frame)
        assert router.route(frame) == before, "a decision changes nothing"
        first: list[Action]
        match event:
            case "frame":
                first = router.on_frame(frame, via, now_ns)
            case "arrival":
                first = router.on_arrival(frame, via, now_ns)
            case "message":
                first = router.on_message(frame, S, now_ns)
            case "request":
                first = router.on_request(frame, S, now_ns)
            case "closed":
                first = router.on_connection_closed(frame, now_ns)
            case "refused":
                first = router.on_refusal(frame, (Status.UNREACHABLE, ""), None, now_ns)
            case "denied":
                first = router.on_denial(frame, "", via, now_ns)
            case _:
                first = router.on_repeat(frame, now_ns)
        performed = carry_out(router, first, now_ns)
        assert performed <= 8, "one pass: each frame leads to a few actions, whatever they cause"
    for now_ns in range(0, 4 * S, S // 4):
        carry_out(router, router.on_timer(now_ns), now_ns)
    assert router.deadline_ns() is None, "everything sent has ended"


def carry_out(router: MessageRouter, actions: list[Action], now_ns: int) -> int:
    """Do as the shell does, with connections that are closed; how many actions it took."""
    queue, done = list(actions), 0
    while queue:
        action = queue.pop(0)
        done += 1
        assert done < 500, "it goes round"
        match action:
            case Arrive(frame):
                queue += router.on_arrival(frame, None, now_ns)
            case SendBack(_, frame):
                queue += router.on_connection_closed(frame, now_ns)
            case HandOver(frame, via, Takes.MESSAGES):
                queue += router.on_outcome(frame, via, Outcome(Status.DELIVERED), now_ns)
            case HandOver(frame, via, Takes.REQUESTS):
                queue += router.on_handler_reply(frame, via, Reply(True), now_ns)
            case Repeat(frame):
                queue += router.on_repeat(frame, now_ns)
            case ToProcess(address, _):
                assert address != OWN
    return done


def test_the_counters_are_those_of_the_payload_type() -> None:
    router = make_router()
    assert router.counters() == MessageCounters()
    router.count_malformed()
    router.on_frame(Frame(FrameKind.BOARD, 1, receiver_hw=HERE), VIA, 0)
    router.on_frame(Frame(FrameKind.ACK, 1, receiver_hw=HERE, receiver_app=LEFT_APP), VIA, 0)
    router.on_frame(Frame(FrameKind.ACK, 1, receiver_hw=HERE, receiver_app=OWN_APP, payload=b"\xc1"), VIA, 0)
    assert router.counters() == MessageCounters(malformed=2, unanswerable=1, unclaimed_answers=1)
