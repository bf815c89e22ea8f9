"""The message endpoint of a process: futures, handlers, gateway and clocks around the router."""

import asyncio
from pathlib import Path

import pytest

from swarmware.errors import NoAnswer
from swarmware.model import names
from swarmware.model.frame import Flag, Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.answer import reply, with_lifetime
from swarmware.transport.delivery.outbox import WINDOW
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.delivery.parts import VALUE_LIMIT
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply
from swarmware.types.time import Conversion

HERE, THERE = names.hardware_id("uav1"), names.hardware_id("uav7")
APP, DATA = 5, 11


class Far:
    """The gateway to another platform whose clock is ten seconds ahead."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.sent: list[Frame] = []
        self.given: list[int] = []
        self.full = False
        node.messaging.add_application(APP)
        node.messaging.set_gateway(self.sent.append)
        node.messaging.serve_messages(DATA, APP, self._take)

    def _take(self, frame: Frame) -> Outcome | None:
        if self.full:
            return None
        self.given.append(frame.sequence)
        return Outcome(Status.DELIVERED, "uav1:app")

    def conversion(self, hardware: int) -> Conversion | None:
        if hardware != THERE:
            return None
        return Conversion("uav7", "main", THERE, 1, 10_000_000_000, 0.0, 0, 0, 0, 0.0, 1)

    async def comes(self, sequence: int, *, age_s: float = 0.0, kind: FrameKind = FrameKind.MESSAGE) -> None:
        """A message of two seconds' lifetime from there, stamped so long ago."""
        stamp_ns = self.node.clock.now_ns() + 10_000_000_000 - round(age_s * 1e9)
        flags = Flag.WANTS_ACK
        frame = Frame(kind, DATA, THERE, 9, HERE, ANY, sequence, stamp_ns, flags=flags)
        frame.extension = with_lifetime(2.0)
        self.node.messaging.deliver(frame)
        await asyncio.sleep(0)

    def answers(self) -> list[tuple[int, int]]:
        """Sequence and status of the acknowledgements so far."""
        acks = [frame for frame in self.sent if frame.kind is FrameKind.ACK]
        return [(frame.sequence, registry.decode(Ack, frame.payload).status) for frame in acks]


async def test_repeated_message_is_delivered_once_acknowledged_twice(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)
        for sequence in (1, 2, 1, 1):
            await far.comes(sequence)
        assert far.given == [1, 2]
        assert far.answers() == [(1, 0), (2, 0), (1, 0), (1, 0)]


async def test_message_without_room_is_delivered_on_repetition(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)
        far.full = True
        await far.comes(1)
        assert far.answers() == [(1, int(Status.UNREACHABLE))], "its sender repeats it, and knows why"
        far.full = False
        await far.comes(1)
        await far.comes(1)
        assert far.given == [1]


@pytest.mark.parametrize("kind", [FrameKind.MESSAGE, FrameKind.NOTIFY, FrameKind.STREAM])
async def test_message_past_senders_lifetime_is_dropped(tmp_path: Path, kind: FrameKind) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)
        node.messaging.add_clocks(far)
        await far.comes(1, age_s=1.0, kind=kind)
        await far.comes(2, age_s=3.0, kind=kind)
        assert far.given == [1]
        assert node.messaging.counters().expired == 1
        await far.comes(1, age_s=3.0, kind=kind)
        assert far.answers() == [(1, 0), (1, 0)], "one that was given in time is still acknowledged"
        node.messaging.remove_clocks(far)
        await far.comes(3, age_s=3.0, kind=kind)
        assert far.given == [1, 3], "nobody can tell"


async def test_a_message_that_nobody_takes_is_answered_so(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)
        node.messaging.remove_application(APP)
        await far.comes(1)
        assert far.answers() == [(1, int(Status.ABSENT))]


async def test_answer_settles_message_and_refusal_names_place(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)
        waiting = node.messaging.send(Frame(FrameKind.MESSAGE, DATA, HERE, APP, THERE, sequence=1), 5.0)
        (question,) = far.sent
        payload = registry.encode(Ack(int(Status.REFUSED), "uav7:planner#1", "not now"))
        node.messaging.deliver(reply(question, FrameKind.ACK, payload, 0))
        outcome = await waiting
        assert (outcome.status, outcome.where, outcome.detail) == (
            Status.REFUSED,
            "uav7:planner#1",
            "not now",
        )
        asked = node.messaging.request(Frame(FrameKind.REQUEST, DATA, HERE, APP, THERE, sequence=2), 5.0)
        node.messaging.deliver(reply(far.sent[-1], FrameKind.REPLY, registry.encode(Reply(True, b"yes")), 0))
        assert (await asked).body == b"yes"


async def test_messages_beyond_window_are_refused_until_room(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        far = Far(node)

        def send(sequence: int) -> asyncio.Future[Outcome]:
            return node.messaging.send(
                Frame(FrameKind.MESSAGE, DATA, HERE, APP, THERE, sequence=sequence), 5.0
            )

        waiting = [send(sequence) for sequence in range(WINDOW)]
        over = await send(WINDOW)
        assert over.status is Status.REFUSED
        assert "wait for an answer" in over.detail
        node.messaging.deliver(reply(far.sent[0], FrameKind.ACK, registry.encode(Ack(0)), 0))
        assert await waiting[0]
        await asyncio.sleep(0)
        assert not send(WINDOW + 1).done()


async def test_sender_learns_of_missing_answer(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        Far(node)
        outcome = await node.messaging.send(
            Frame(FrameKind.MESSAGE, DATA, HERE, APP, THERE, sequence=1), 0.02
        )
        assert outcome.status is Status.EXPIRED
        with pytest.raises(NoAnswer):
            await node.messaging.request(Frame(FrameKind.REQUEST, DATA, HERE, APP, THERE, sequence=2), 0.02)


async def test_oversized_answer_is_error_of_its_request(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        node.messaging.add_application(APP)
        node.messaging.serve_requests(
            DATA, APP, lambda frame, respond: respond(Reply(True, bytes(VALUE_LIMIT + 1)))
        )
        answer = await node.messaging.request(
            Frame(FrameKind.REQUEST, DATA, HERE, APP, HERE, sequence=1), 5.0
        )
        assert (answer.ok, answer.kind) == (False, "OutOfRange")
