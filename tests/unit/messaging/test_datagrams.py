"""Datagrams of video in the message router: they reach a handler of datagrams alone, and nobody answers."""

import pytest
from tests.unit.messaging.routing import (
    BROKER,
    ELSEWHERE,
    HERE,
    MESSAGES,
    NOWHERE,
    OTHER,
    OWN_APP,
    REQUESTS,
    THERE,
    VIA,
    make_router,
)

from swarmware.model.frame import Flag, Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.transport.messaging.router import (
    Arrive,
    Drop,
    HandOver,
    MessageRouter,
    SendBack,
    Takes,
    ToGateway,
    ToProcess,
)

DATAGRAMS = 15


def router_of_video(*, gateway: bool = False) -> MessageRouter:
    router = make_router(gateway=gateway)
    router.serve(DATAGRAMS, OWN_APP, Takes.DATAGRAMS)
    return router


def datagram(data_id: int, receiver_hw: int = HERE, *, flags: int = 0) -> Frame:
    return Frame(FrameKind.RTP, data_id, THERE, 9, receiver_hw, ANY, 1, flags=flags, payload=b"rtp")


def test_datagram_is_delivered_each_time_unanswered() -> None:
    router, frame = router_of_video(), datagram(DATAGRAMS)
    assert router.on_frame(frame, None, 0) == [Arrive(frame)]
    for _ in range(2):
        assert router.on_arrival(frame, None, 0) == [HandOver(frame, None, Takes.DATAGRAMS)]
        assert router.on_frame(frame, VIA, 0) == [HandOver(frame, VIA, Takes.DATAGRAMS)]


@pytest.mark.parametrize("data_id", [MESSAGES, REQUESTS, NOWHERE])
@pytest.mark.parametrize("flags", [0, Flag.WANTS_ACK, Flag.URGENT])
def test_no_datagram_reaches_handler_of_messages_or_requests(data_id: int, flags: int) -> None:
    router, frame = router_of_video(), datagram(data_id, flags=flags)
    assert router.on_arrival(frame, None, 0) == []
    actions = router.on_frame(frame, VIA, 0)
    assert not any(isinstance(one, HandOver | SendBack) for one in actions)


@pytest.mark.parametrize("kind", [FrameKind.MESSAGE, FrameKind.REQUEST, FrameKind.NOTIFY])
def test_datagram_handler_refuses_messages_and_requests(kind: FrameKind) -> None:
    router = router_of_video()
    frame = Frame(kind, DATAGRAMS, THERE, 9, HERE, ANY, 1, flags=Flag.WANTS_ACK)
    (action,) = router.on_arrival(frame, VIA, 0)
    assert isinstance(action, SendBack)
    assert action.frame.kind is FrameKind.ACK


def test_datagrams_pass_to_other_processes_and_through_broker() -> None:
    away = datagram(DATAGRAMS, THERE)
    assert router_of_video().route(away) == ToProcess(BROKER, away)
    assert router_of_video(gateway=True).route(away) == ToGateway(away)
    here = datagram(ELSEWHERE)
    assert router_of_video().route(here) == ToProcess(OTHER, here)


def test_unreceived_datagram_is_dropped_and_counted() -> None:
    router, frame = router_of_video(), datagram(NOWHERE)
    assert router.route(frame) == Drop("unclaimed_datagrams")
    assert router.on_frame(frame, VIA, 0) == []
    assert router.counters().unclaimed_datagrams == 1
