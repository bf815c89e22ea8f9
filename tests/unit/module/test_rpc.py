"""The answering end of requests: handlers and coroutines, their errors, and a limit of requests in work."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmware.errors import KINDS, Conflict, NoAnswer, OutOfRange, SwarmError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import ANY, data_id
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.rpc import IN_WORK_LIMIT, Server
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.rpc import Reply
from swarmware.types.scalar import Int, Text


class Refused(OutOfRange):
    """An error class of a user, below one of ours."""


def raising(error: Exception) -> Callable[[Int, Meta], Int]:
    def handler(request: Int, meta: Meta) -> Int:
        raise error

    return handler


def raising_later(error: Exception) -> Callable[[Int, Meta], Any]:
    async def handler(request: Int, meta: Meta) -> Int:
        await asyncio.sleep(0)
        raise error

    return handler


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("how", [raising, raising_later])
async def test_each_handler_error_keeps_its_class(
    tmp_path: Path, kind: str, how: Callable[[Exception], Any]
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.serve("sys/step", Int, how(KINDS[kind]("5 legs; expected 4")), reply=Int)
        with pytest.raises(SwarmError, match="5 legs; expected 4") as found:
            await m.request("sys/step", Int(5), Int)
        assert type(found.value) is KINDS[kind]


@pytest.mark.parametrize("how", [raising, raising_later])
@pytest.mark.parametrize(
    ("error", "kind", "text"),
    [
        (Refused("no"), OutOfRange, "no"),
        (KeyError("legs"), SwarmError, "sys/step: KeyError: 'legs'"),
        (RuntimeError(""), SwarmError, "sys/step: RuntimeError"),
    ],
)
async def test_foreign_error_arrives_as_nearest_class(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    how: Callable[[Exception], Any],
    error: Exception,
    kind: type[SwarmError],
    text: str,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.serve("sys/step", Int, how(error), reply=Int)
        with pytest.raises(kind, match=text) as found:
            await m.request("sys/step", Int(5), Int)
        assert type(found.value) is kind
        assert ("the handler failed" in caplog.text) == (kind is SwarmError), "only a mistake is logged"


async def test_a_coroutine_answers_while_others_are_in_work(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        gates = {number: asyncio.Event() for number in (1, 2)}

        async def handler(request: Int, meta: Meta) -> Text:
            await gates[request.value].wait()
            return Text(f"{request.value} of {meta.sender_app == m.app_id}")

        m.serve("sys/step", Int, handler, reply=Text)
        first, second = (asyncio.create_task(m.request("sys/step", Int(n), Text)) for n in (1, 2))
        gates[2].set()
        assert await second == Text("2 of True")
        assert not first.done()
        gates[1].set()
        assert await first == Text("1 of True")


async def test_requests_beyond_limit_are_refused_until_room(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        gate = asyncio.Event()

        async def handler(request: Int, meta: Meta) -> Int:
            await gate.wait()
            return request

        m.serve("sys/step", Int, handler, reply=Int)
        many = [asyncio.create_task(m.request("sys/step", Int(n), Int)) for n in range(IN_WORK_LIMIT)]
        await asyncio.sleep(0)
        with pytest.raises(NoAnswer, match=f"sys/step: {IN_WORK_LIMIT} requests in work"):
            await m.request("sys/step", Int(-1), Int)
        gate.set()
        assert [answer.value for answer in await asyncio.gather(*many)] == list(range(IN_WORK_LIMIT))
        assert await m.request("sys/step", Int(7), Int) == Int(7)


def frame(payload: bytes) -> Frame:
    return Frame(FrameKind.REQUEST, data_id("sys/step", "Int"), 1, 2, 3, ANY, 4, payload=payload)


async def test_mistyped_request_is_answered_with_reason() -> None:
    replies: list[Reply] = []
    server = Server("sys/step", Int, lambda request, _: request, lambda *_: None)
    for payload in (b"\xff", b"", registry.encode(Text("one"))):
        server.on_request(frame(payload), replies.append)
    assert [(reply.ok, reply.kind) for reply in replies] == [(False, "WireError")] * 3
    assert all("payload of type Int" in reply.error for reply in replies)


async def test_waiter_learns_that_application_ended() -> None:
    replies: list[Reply] = []
    tasks: list[asyncio.Task[None]] = []

    async def never(request: Int, meta: Meta) -> Int:
        await asyncio.Event().wait()
        return request

    server = Server(
        "sys/step", Int, never, lambda work, name: tasks.append(asyncio.create_task(work, name=name))
    )
    server.on_request(frame(registry.encode(Int(1))), replies.append)
    assert [task.get_name() for task in tasks] == ["serve sys/step"]
    await asyncio.sleep(0)
    tasks[0].cancel()
    await asyncio.wait(tasks)
    assert [(reply.kind, reply.error) for reply in replies] == [
        ("NoAnswer", "sys/step: the application ends")
    ]


async def test_address_belongs_to_one_application_until_departure(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        async with Module("first", node=node) as m, Module("second", node=node) as n:
            m.serve("sys/step", Int, lambda request, _: request, reply=Int)
            m.inbox("cmd/step", Int)
            await asyncio.sleep(0)  # declarations are written at the next turn of the loop
            for taking in (
                lambda: n.serve("sys/step", Int, lambda request, _: request),
                lambda: n.inbox("cmd/step", Int),
            ):
                with pytest.raises(Conflict, match="served by first#1 already; expected one"):
                    taking()
        async with Module("second", node=node) as n:
            n.serve("sys/step", Int, lambda request, _: request, reply=Int)
            n.inbox("cmd/step", Int)
            assert await n.request("sys/step", Int(1), Int) == Int(1)
