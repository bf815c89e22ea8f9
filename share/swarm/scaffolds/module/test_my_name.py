"""Tests of my_name, without a running node: each makes one in a temporary folder."""

import asyncio
from pathlib import Path

from swarmware import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Float

from my_name import MyName


def test_the_value_is_published(tmp_path: Path) -> None:
    async def check() -> None:
        async with tmp_node(tmp_path) as node, Module("my_name", node=node) as module:
            board = module.reader("my_name/value", Float)
            module.start(MyName(module).run(), "run")
            assert await board.changed(timeout_s=10.0) == Float(20.0)

    asyncio.run(check())


def test_command_sets_offset_and_answers_former(tmp_path: Path) -> None:
    async def check() -> None:
        async with tmp_node(tmp_path) as node, Module("my_name", node=node) as module:
            mine = MyName(module)
            old = await module.request("cmd/my_name", Float(1.5), Float)
            assert old == Float(0.0)
            assert mine.measure() == Float(21.5)

    asyncio.run(check())
