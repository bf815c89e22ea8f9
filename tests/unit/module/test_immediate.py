"""A module's boards, streams, inboxes and services are open at once; awaiting them works for one release."""

import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmware.health.monitor import HealthMonitor
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.runtime.immediate import Immediate
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.types.scalar import Float, Int

OPENING: dict[str, Callable[[Module], Immediate]] = {
    "writer": lambda m: m.writer("nav/height", Float),
    "stream_writer": lambda m: m.stream_writer("plan/steps", Int),
    "reader": lambda m: m.reader("nav/height", Float),
    "readers": lambda m: m.readers("/*/nav/height", Float),
    "stream_reader": lambda m: m.stream_reader("plan/steps", Int),
    "inbox": lambda m: m.inbox("cmd/step", Int),
    "serve": lambda m: m.serve("sys/echo", Int, lambda request, _: request, reply=Int),
    "register": lambda m: HealthMonitor(m).register(
        "height", frequency_hz=1.0, data=lambda: 1.0, criterion=lambda _: "ok"
    ),
}


@pytest.mark.parametrize("method", OPENING)
async def test_what_a_module_opens_is_there_at_once_and_may_still_be_awaited(
    tmp_path: Path, method: str
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        opened = OPENING[method](m)
        with pytest.warns(DeprecationWarning, match="expected no `await`") as seen:
            assert await opened is opened
        assert seen[0].filename == __file__, "it points at the line of the user"


async def test_opening_without_await_warns_of_nothing(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            writer, reader = m.writer("nav/height", Float), m.reader("nav/height", Float)
            writer.write(Float(2.0))
            assert reader.value == Float(2.0)


async def test_a_node_is_attached_shared_and_closed_at_once_and_may_still_be_awaited(
    tmp_path: Path,
) -> None:
    folder = make_node(tmp_path)
    with pytest.warns(DeprecationWarning, match="expected no `await`") as seen:
        node = await Node.attach(folder)
        assert await node.share() is node
        await node.close()
        assert Node.attach(folder) is node, "one user is left"
        node.close()
        await node.close()
    assert {warning.filename for warning in seen} == {__file__}
    assert len(seen) == 4
    other = Node.attach(folder)
    assert other is not node, "the last user has left"
    other.close()
