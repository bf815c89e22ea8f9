"""The node as a process has it: once, shared by its modules, gone with the last of them."""

import asyncio
from pathlib import Path

import pytest

from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.node import node as node_module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.transport.shm.doorbell import MIRRORS, Doorbell
from swarmware.transport.shm.layout import readers_folder, ring_file
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingReader
from swarmware.types.scalar import Float


async def test_modules_of_one_process_share_the_node_and_the_last_one_closes_it(tmp_path: Path) -> None:
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


async def test_a_bell_wakes_who_watches_as_long_as_somebody_listens(tmp_path: Path) -> None:
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
        async with asyncio.timeout(5):
            await rung.wait()
        node.unwatch(watcher)
        node.unlisten(readers)


async def test_a_mirror_lies_in_the_folder_of_its_platform_and_is_told_of(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        before_ns = node.shm_dir.stat().st_mtime_ns
        mirror = node.mirror_writer("uav7", "nav/height")
        mirror.publish(b"x" * 5000)
        with RingReader(ring_file(node.shm_dir, "nav/height", "uav7")) as ring:
            assert ring.newest() == b"x" * 5000, "it has grown"
        assert node.shm_dir.stat().st_mtime_ns > before_ns, "who looks for new mirrors sees a change"
        mirror.close()
        assert not ring_file(node.shm_dir, "nav/height", "uav7").exists()


class Watcher:
    """Sets an event at the next ring of the node's doorbell."""

    def __init__(self, heard: asyncio.Event) -> None:
        self._heard = heard

    def poll(self) -> None:
        self._heard.set()


async def rings(doorbell: Doorbell) -> bool:
    """Whether it rings."""
    ringing = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_reader(doorbell.fd, ringing.set)
    try:
        async with asyncio.timeout(20.0):
            await ringing.wait()
    finally:
        loop.remove_reader(doorbell.fd)
    return doorbell.drain()


@pytest.mark.parametrize("tells", [True, False])
async def test_a_reader_that_enters_between_two_frames_is_woken_for_the_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tells: bool
) -> None:
    if tells:  # who does not is found at the next check of the files
        monkeypatch.setattr(node_module, "TEND_NS", 1 << 60)
    async with tmp_node(tmp_path) as node:
        writer = node.publication("nav/pose", slots=4, slot_bytes=64)
        writer.publish(b"one")
        readers = readers_folder(ring_file(node.shm_dir, "nav/pose"))
        with Doorbell(paths.doorbells(node.run_dir)) as doorbell:
            if tells:
                with ReaderNotifier(readers, node.doorbells) as reader:
                    reader.add(doorbell.name)
            else:
                (readers / doorbell.name).touch()
            writer.publish(b"two")
            assert await rings(doorbell)
            writer.publish(b"three")
            assert doorbell.drain(), "from now on at once"
        writer.close()


async def test_every_process_of_the_node_is_told_of_a_new_mirror(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        with Doorbell(paths.doorbells(node.run_dir)) as other:
            before = node.mirrors
            mirror = node.mirror_writer("uav7", "nav/height")
            assert node.mirrors > before
            assert other.drain()
            assert other.received(MIRRORS)
            before = node.mirrors
            node.doorbells.ring(node.doorbell.name, MIRRORS)
            heard = asyncio.Event()
            node.watch(Watcher(heard))
            async with asyncio.timeout(20.0):
                await heard.wait()
            assert node.mirrors > before
            mirror.close()
