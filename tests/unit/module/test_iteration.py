"""What is read with `async for`, and commands whose record cannot be written."""

import asyncio
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import Conflict, NoAnswer, NotFound, TypeMismatch
from swarmware.module import accepted as accepted_module
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.mission import MissionAbort
from swarmware.types.scalar import Float, Int, Text


async def test_board_iterates_newest_and_stream_every_item(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights, steps = m.writer("nav/height", Float), m.stream_writer("plan/steps", Int)
        board, stream = m.reader("nav/height", Float), m.stream_reader("plan/steps", Int)
        for number in range(5):
            heights.write(Float(number))
            steps.write(Int(number))
        async for value in board:
            assert value == Float(4.0)
            break
        taken = []
        async for item in stream:
            taken.append(item.value)
            if len(taken) == 5:
                break
        assert taken == list(range(5))
        with pytest.raises(NoAnswer, match=r"stream plan/steps: nothing new within 0\.01 s"):
            await stream.next(0.01)


async def test_who_iterates_is_given_what_comes_later(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        board, stream, box = (
            m.reader("nav/height", Float),
            m.stream_reader("plan/steps", Int),
            m.inbox("cmd/note", Text),
        )
        waiting = [asyncio.create_task(anext(one)) for one in (board, stream, box)]
        await asyncio.sleep(0)
        m.writer("nav/height", Float).write(Float(1.0))
        m.stream_writer("plan/steps", Int).write(Int(2))
        assert await m.send("cmd/note", Text("three"))
        async with asyncio.timeout(20.0):
            assert await asyncio.gather(*waiting) == [Float(1.0), Int(2), Text("three")]


async def test_command_is_accepted_although_it_cannot_be_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def publication(self: Node, path: str, **_: object) -> Publication:
        raise Conflict(f"{path}: written by another process")

    async with tmp_node(tmp_path) as node, Module("mission", node=node) as m:
        monkeypatch.setattr(Node, "publication", publication)
        box = m.inbox("cmd/abort", MissionAbort)
        assert await m.send("cmd/abort", MissionAbort(reason="first"))
        assert (await box.next(PATIENCE_S)).reason == "first"
        assert caplog.text.count("cmd/abort: ") >= 2, "at its opening and at each command"
        monkeypatch.undo()
        assert await m.send("cmd/abort", MissionAbort(reason="second"))
        assert (await box.next(PATIENCE_S)).reason == "second"
        assert (node.shm_dir / "cmd.abort.ring").exists(), "recorded from now on"


async def test_without_a_readable_template_nothing_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path, template="nosuch") as node, Module("mission", node=node) as m:
        accepted_module.recorded.cache_clear()
        box = m.inbox("cmd/abort", MissionAbort)
        assert await m.send("cmd/abort", MissionAbort(reason="first"))
        assert (await box.next(PATIENCE_S)).reason == "first"
        assert "cmd/abort: " in caplog.text
        assert not (node.shm_dir / "cmd.abort.ring").exists()


async def test_mistyped_request_mismatches_and_unaddressed_is_missing(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.serve("sys/step", Int, lambda request, _: request, reply=Int)
        await asyncio.sleep(0)
        with pytest.raises(TypeMismatch, match="sys/step of planner#1 takes Int, not Text"):
            await m.request("sys/step", Text("one"), Int)
        with pytest.raises(NotFound, match="sys/other"):
            await m.request("sys/other", Int(1), Int, timeout_s=0.1)
