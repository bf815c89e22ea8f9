"""Several event loops in one process: each has a socket and a doorbell of its own."""

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.module.inbox import Inbox
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import make_node
from swarmware.types.scalar import Int

LOOPS = 3


@pytest.fixture
def config_dir(tmp_path: Path) -> Iterator[Path]:
    folder = make_node(tmp_path)
    with no_leaks(tmp_path):
        yield folder


class Worker(threading.Thread):
    """A module on an event loop of its own thread; doubles every number it receives onto a board."""

    def __init__(self, number: int, config_dir: Path) -> None:
        super().__init__(name=f"worker{number}")
        self._config_dir = config_dir
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self.joined = threading.Event()
        self.endpoint = ""

    def run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._main())

    async def _main(self) -> None:
        async with Module(self.name, config_dir=self._config_dir) as module:
            inbox = module.inbox(f"{self.name}/number", Int)
            board = module.writer(f"{self.name}/double", Int)
            self.endpoint = module.node.messaging.address
            module.start(self._double(inbox, board), "double")
            self.joined.set()
            await self._end.wait()

    async def _double(self, inbox: Inbox[Int], board: BoardWriter[Int]) -> None:
        async for number in inbox:
            board.write(Int(2 * number.value))

    def end(self) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self.join(PATIENCE_S)


def test_modules_in_several_threads_all_receive_their_messages(config_dir: Path) -> None:
    async def run(workers: list[Worker]) -> None:
        async with Module("test", config_dir=config_dir) as module:
            boards = [module.reader(f"{worker.name}/double", Int) for worker in workers]
            for number in range(1, 4):
                for worker, board in zip(workers, boards, strict=True):
                    assert await module.send(f"{worker.name}/number", Int(number), timeout_s=PATIENCE_S)
                    while board.value != Int(2 * number):
                        await board.changed(PATIENCE_S)

    workers = [Worker(number, config_dir) for number in range(LOOPS)]
    try:
        for worker in workers:
            worker.start()
            assert worker.joined.wait(PATIENCE_S)
        assert len({worker.endpoint for worker in workers}) == LOOPS
        asyncio.run(run(workers))
    finally:
        for worker in workers:
            worker.end()
    assert not any(worker.is_alive() for worker in workers)
