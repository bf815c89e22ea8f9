"""A changed setting is followed until the applications that have it state the value."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from swarmd.tree.settings.settings import SettingEffect
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.service.live_config import LiveConfig
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Float
from swarmware.types.tree import TreeSetDone

KP = Resource(path="config/pilot/kp", kind=Kind.SETTING, type="Float", default=1.2)
LIVE = {"kp_1_s": "pilot/kp"}
DONE = TreeSetDone("/uav1/config/pilot/kp", 2, "Float", msgspec.msgpack.encode([4.0]))


class Config(msgspec.Struct, frozen=True):
    """Gains of a pilot."""

    kp_1_s: float = 1.2


class Bench:
    """A tree with the board of a setting, and a pilot that has it."""

    def __init__(self, tree: Module, pilot: Module) -> None:
        self.tree = tree
        self.board: BoardWriter[Float] = tree.writer(KP, Float)
        self.live = LiveConfig(pilot, Config(), LIVE)
        # the tree of a node watches its applications always
        tree.node.applications.subscribe(lambda _: None)

    async def followed(self, value: float, apply_s: float = 30.0) -> TreeSetDone:
        """The answer to a change that was just stored."""
        self.board.write(Float(value))
        return await SettingEffect(self.tree, apply_s).followed(KP.path, Float(value), DONE)


@asynccontextmanager
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    async with (
        tmp_node(tmp_path) as node,
        Module("tree", node=node) as tree,
        Module("pilot", node=node, config=Config(), live_settings=LIVE) as pilot,
    ):
        yield Bench(tree, pilot)


async def test_answer_comes_when_application_has_taken_value(tmp_path: Path) -> None:
    async with bench(tmp_path) as made:
        answer = asyncio.ensure_future(made.followed(4.0))
        for _ in range(10):
            await asyncio.sleep(0)
        assert not answer.done(), "it has not looked yet"
        assert made.live.take() == Config(4.0)
        assert await answer == msgspec.structs.replace(DONE, applied_by=("pilot",))


async def test_value_already_in_force_is_confirmed(tmp_path: Path) -> None:
    async with bench(tmp_path) as made:
        made.board.write(Float(4.0))
        assert made.live.take() == Config(4.0)
        made.board.write(Float(4.0))
        assert made.live.take() is None
        assert (await made.followed(4.0)).applied_by == ("pilot",)


@pytest.mark.parametrize("taken", [None, 3.0])
async def test_application_not_taking_it_is_named(tmp_path: Path, taken: float | None) -> None:
    async with bench(tmp_path) as made:
        if taken is not None:
            made.board.write(Float(taken))
            made.live.take()
        done = await made.followed(4.0, apply_s=0.05)
        assert (done.applied_by, done.awaited) == ((), ("pilot",))


async def test_setting_without_application_is_answered_at_once(tmp_path: Path) -> None:
    async with bench(tmp_path) as made:
        found = await SettingEffect(made.tree, 30.0).followed("config/other/kp", Float(4.0), DONE)
        assert found == DONE
