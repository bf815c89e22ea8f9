"""A ZeroMQ socket on the event loop: it is read when something waits, and not once more."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import zmq
from tests.patience import PATIENCE_S, until

from swarmd.broker.sockets.zmq.zmq_socket import TURN, Socket, ZmqSocket, make_context

SOCKETS = 8


@asynccontextmanager
async def watched(take: Callable[[Socket], None]) -> AsyncIterator[tuple[ZmqSocket, Socket]]:
    """A watched socket, and a socket that sends to it."""
    context = make_context(SOCKETS)
    receiver, sender = context.socket(zmq.PULL), context.socket(zmq.PUSH)
    port = receiver.bind_to_random_port("tcp://127.0.0.1")
    sender.connect(f"tcp://127.0.0.1:{port}")
    socket = ZmqSocket(receiver, asyncio.get_running_loop(), take)
    try:
        yield socket, sender
    finally:
        socket.close()
        context.destroy(linger=0)


async def test_simultaneous_messages_are_taken_in_bounded_turns() -> None:
    got: list[bytes] = []

    def take(socket: Socket) -> None:
        with contextlib.suppress(zmq.Again):
            got.append(socket.recv(zmq.NOBLOCK))

    sent = [b"%d" % number for number in range(5 * TURN)]
    async with watched(take) as (_, sender):
        for data in sent:
            sender.send(data)
        await until(lambda: len(got) == len(sent))
    assert got == sent


async def test_single_message_causes_no_empty_attempt() -> None:
    got: list[bytes] = []
    empty = 0

    def take(socket: Socket) -> None:
        nonlocal empty
        try:
            got.append(socket.recv(zmq.NOBLOCK))
        except zmq.Again:
            empty += 1

    async with watched(take) as (_, sender):
        sender.send(b"first")
        await until(lambda: len(got) == 1)
        before = empty
        for number in range(20):
            sender.send(b"%d" % number)
            await until(lambda number=number: len(got) == number + 2)  # type: ignore[misc]
        assert empty - before < 10, "every message was looked for twice"


async def test_a_handler_may_close_its_socket() -> None:
    ended = asyncio.Event()

    def take(socket: Socket) -> None:
        with contextlib.suppress(zmq.Again):
            socket.recv(zmq.NOBLOCK)
            it.close()
            ended.set()

    async with watched(take) as (it, sender):
        sender.send(b"end")
        await asyncio.wait_for(ended.wait(), PATIENCE_S)
        assert it.is_closed
