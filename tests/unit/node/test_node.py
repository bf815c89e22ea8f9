"""The node as a process has it: once, shared by its modules, gone with the last of them."""

import asyncio
from pathlib import Path

from tests.patience import PATIENCE_S

from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.transport.shm.layout import readers_folder, ring_file
from swarmware.transport.shm.ring import RingReader
from swarmware.types.scalar import Float


async def test_modules_share_node_and_last_closes_it(tmp_path: Path) -> None:
    folder = await asyncio.to_thread(make_node, tmp_path)
    async with Module("planner", config_dir=folder) as one:
        async with Module("mapper", config_dir=folder) as other:
            assert one.node is other.node
        assert Node.attach(folder) is one.node, "it lives as long as somebody uses it"
        one.node.close()
        former = one.node
    again = Node.attach(folder)
    assert again is not former
    again.close()
    assert not list((tmp_path / "uav1" / "run" / "p").iterdir()), "no socket is left"


async def test_bell_wakes_watchers_while_listened_to(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        rung = asyncio.Event()

        class Watcher:
            def poll(self) -> None:
                rung.set()

        watcher = Watcher()
        readers = readers_folder(ring_file(node.shm_dir, "nav/height"))
        writer = m.writer("nav/height", Float)
        node.watch(watcher)
        node.listen(readers)
        node.listen(readers)
        node.unlisten(readers)
        # still one who listens; bells of others may ring too, so the last of ours is waited for
        rung.clear()
        writer.write(Float(1.0))
        async with asyncio.timeout(PATIENCE_S):
            await rung.wait()
        node.unwatch(watcher)
        node.unlisten(readers)


async def test_mirror_lies_in_platform_folder_announced(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        before_ns = node.shm_dir.stat().st_mtime_ns
        mirror = node.mirror_writer("uav7", "nav/height")
        mirror.publish(b"x" * 5000)
        with RingReader(ring_file(node.shm_dir, "nav/height", "uav7")) as ring:
            assert ring.newest() == b"x" * 5000, "it has grown"
        assert node.shm_dir.stat().st_mtime_ns > before_ns, "who looks for new mirrors sees a change"
        mirror.close()
        assert not ring_file(node.shm_dir, "nav/height", "uav7").exists()
