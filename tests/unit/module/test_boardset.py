"""The same board of all other platforms: found as its mirrors appear, waited for, let go."""

import asyncio
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.module.boardset import BoardSet
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.scalar import Float

PATH = "nav/height"


def publish(mirror: Publication, platform: str, height: float) -> None:
    frame = Frame(
        FrameKind.BOARD, data_id(PATH, "Float"), hardware_id(platform), payload=registry.encode(Float(height))
    )
    mirror.publish(encode(frame))


async def waiting(boards: BoardSet[Float]) -> asyncio.Task[tuple[str, ...]]:
    """A task that has looked, found nothing, and waits."""
    task = asyncio.create_task(boards.changed(PATIENCE_S))
    await asyncio.sleep(0)
    assert not task.done()
    return task


async def test_waiter_is_woken_by_mirror_and_values(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        task = await waiting(heights)
        mirror = node.mirror_writer("uav7", PATH)
        publish(mirror, "uav7", 4.0)
        assert await task == ("uav7",)
        task = await waiting(heights)
        publish(mirror, "uav7", 5.0)
        assert await task == ("uav7",)
        assert heights["uav7"].value == Float(5.0)
        mirror.close()


async def test_each_change_is_given_once_per_set(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        mirrors = {name: node.mirror_writer(name, PATH) for name in ("uav7", "uav8")}
        for name, mirror in mirrors.items():
            publish(mirror, name, 4.0)
        assert sorted(await heights.changed(PATIENCE_S)) == ["uav7", "uav8"]
        publish(mirrors["uav8"], "uav8", 5.0)
        assert await heights.changed(PATIENCE_S) == ("uav8",)
        with pytest.raises(NoAnswer):
            await heights.changed(0.01)
        one = asyncio.create_task(heights["uav7"].changed(PATIENCE_S))
        await asyncio.sleep(0)
        publish(mirrors["uav7"], "uav7", 6.0)
        assert await one == Float(6.0)
        assert await heights.changed(PATIENCE_S) == ("uav7",)
        for mirror in mirrors.values():
            mirror.close()


@pytest.mark.parametrize("pattern", [f"/*/{PATH}", f"/uav*/{PATH}"])
async def test_platforms_match_pattern_and_exclude_own(tmp_path: Path, pattern: str) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(pattern, Float)
        mirrors = [
            mirror_of(node, "uav7", PATH),
            mirror_of(node, "uav1", PATH),
            mirror_of(node, "uav8", "nav/width"),
        ]
        assert list(heights) == ["uav7"]
        mirrors.append(mirror_of(node, "ugv1", PATH))
        assert sorted(heights) == sorted({"uav7", "ugv1"} if pattern.startswith("/*") else {"uav7"})
        for mirror in mirrors:
            mirror.close()


async def test_platform_is_found_by_name_without_listing(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        mirror = mirror_of(node, "uav7", PATH)
        assert heights["uav7"].value == Float(1.0)
        with pytest.raises(KeyError):
            heights["uav8"]
        mirror.close()


async def test_a_set_that_was_closed_listens_no_more(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        before = dict(node._listens), dict(node._watchers)
        with pytest.raises(NoAnswer, match=r"boards /\*/nav/height: no new value within 0.01 s"):
            await heights.changed(0.01)
        assert (dict(node._listens), dict(node._watchers)) != before
        heights.close()
        heights.close()
        assert (dict(node._listens), dict(node._watchers)) == before


def mirror_of(node: Node, platform: str, path: str) -> Publication:
    """A mirror with a value."""
    mirror = node.mirror_writer(platform, path)
    publish(mirror, platform, 1.0)
    return mirror


async def test_platform_returning_with_one_value_is_news(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        mirror = mirror_of(node, "uav7", PATH)
        assert await heights.changed(PATIENCE_S) == ("uav7",)
        mirror.close()
        again = node.mirror_writer("uav7", PATH)
        with pytest.raises(NoAnswer):
            await heights.changed(0.01)
        publish(again, "uav7", 2.0)
        assert await heights.changed(PATIENCE_S) == ("uav7",)
        assert heights["uav7"].value == Float(2.0)
        again.close()


async def test_news_wake_later_waiter_without_loss(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers(f"/*/{PATH}", Float)
        assert heights.news() == ()
        mirror = node.mirror_writer("uav7", PATH)
        publish(mirror, "uav7", 4.0)
        assert heights.news() == ("uav7",)
        assert heights.news() == ()
        task = await waiting(heights)
        publish(mirror, "uav7", 5.0)
        assert await task == ("uav7",)
        assert heights.news() == ()
        mirror.close()
