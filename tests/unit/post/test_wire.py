"""The sockets of a process: nothing lost that was acknowledged, nothing waited for."""

import asyncio
import time
from pathlib import Path

import pytest

from swarmware.errors import InvalidInput
from swarmware.transport.messaging.wire import QUEUE_LIMIT, Identity, Wire


class Heard:
    """What came, in order."""

    def __init__(self) -> None:
        self._queue: asyncio.Queue[tuple[bytes, Identity | None]] = asyncio.Queue()

    def __call__(self, data: bytes, identity: Identity | None) -> None:
        self._queue.put_nowait((data, identity))

    async def next(self) -> tuple[bytes, Identity | None]:
        return await asyncio.wait_for(self._queue.get(), 10)


def test_the_last_answer_of_a_process_that_ends_arrives(tmp_path: Path) -> None:
    async def run() -> None:
        heard, asked = Heard(), Heard()
        here, there = Wire(tmp_path / "a", heard), Wire(tmp_path / "b", asked)
        here.send(there.endpoint, b"question")
        _, identity = await asked.next()
        assert identity is not None
        assert there.send_back(identity, b"answer")
        there.close()
        time.sleep(0.1)  # noqa: ASYNC251 - so that answer and disconnection are there together
        assert await heard.next() == (b"answer", None)
        here.close()

    asyncio.run(run())


def test_frames_to_a_process_that_is_not_there_wait_in_a_bounded_queue(tmp_path: Path) -> None:
    async def run() -> None:
        wire = Wire(tmp_path / "a", Heard())
        taken = sum(wire.send(f"ipc://{tmp_path}/nobody", b"x") for _ in range(3 * QUEUE_LIMIT))
        assert QUEUE_LIMIT <= taken <= QUEUE_LIMIT + 128
        assert wire.dropped == 3 * QUEUE_LIMIT - taken
        began_s = time.monotonic()
        wire.close()
        assert time.monotonic() - began_s < 5

    asyncio.run(run())


def test_urgent_frames_overtake_those_that_wait(tmp_path: Path) -> None:
    async def run() -> None:
        heard = Heard()
        here = Wire(tmp_path / "a", Heard())
        for number in range(500):
            here.send(f"ipc://{tmp_path}/b", b"%d" % number)
        here.send(f"ipc://{tmp_path}/b", b"urgent", urgent=True)
        there = Wire(tmp_path / "b", heard)
        came = [(await heard.next())[0] for _ in range(501)]
        others = [data for data in came if data != b"urgent"]
        assert others == [b"%d" % number for number in range(500)]
        assert came.index(b"urgent") <= 128
        here.close()
        there.close()

    asyncio.run(run())


def test_a_way_to_a_process_that_is_gone_is_closed_and_made_again(tmp_path: Path) -> None:
    async def run() -> None:
        heard = Heard()
        here, there = Wire(tmp_path / "a", Heard()), Wire(tmp_path / "b", heard)
        here.send(there.endpoint, b"1")
        here.keep_only([])
        here.keep_only([there.endpoint])
        here.keep_only([])
        await asyncio.sleep(1.1)
        here.send(there.endpoint, b"2")
        assert [(await heard.next())[0], (await heard.next())[0]] == [b"1", b"2"]
        here.close()
        there.close()

    asyncio.run(run())


def test_a_path_too_long_for_a_socket_says_so(tmp_path: Path) -> None:
    async def run() -> None:
        with pytest.raises(InvalidInput, match="shorter run_dir"):
            Wire(tmp_path / ("x" * 107), Heard())

    asyncio.run(run())
