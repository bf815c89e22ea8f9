"""Moves the blocks of a file, several at a time, through failures of the link."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from time import monotonic_ns
from typing import Final

import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.progress import Progress
from swarmware.errors import NoAnswer
from swarmware.transport.transfer.block_window import BlockWindow

SLOW_TIMEOUT_S: Final = 60.0
"""Time for a request after which the other side reads or checks a whole file."""


class MovedFile(msgspec.Struct, frozen=True):
    """A file that was sent or fetched."""

    node: str
    name: str
    size_bytes: int
    digest: str
    """BLAKE2b-256 of the content, hex."""
    resumed_bytes: int
    """Bytes that were there from a former transfer."""
    path: str = ""
    """Path of a received file on this computer, or "" for a sent file."""


async def move_blocks(
    session: Session,
    ranges: Iterable[tuple[int, int]],
    move: Callable[[int, float], Awaitable[object]],
    give_up_s: float,
    progress: Progress,
) -> None:
    """Calls `move` for each block with its time-out in s, again where it raises NoAnswer, a window of them at
    a time.

    Raises: NoAnswer when no block has passed for `give_up_s`; other errors of `move`.
    """
    window, loop = BlockWindow(ranges, monotonic_ns()), asyncio.get_running_loop()
    under_way: dict[asyncio.Task[object], int] = {}

    async def one(number: int, timeout_s: float) -> object:
        return await move(number, timeout_s)

    try:
        while not window.is_done:
            # filled again after each answer, so that the link never waits for a request
            while (number := window.take(monotonic_ns())) is not None:
                under_way[loop.create_task(one(number, window.timeout_s), name=f"block {number}")] = number
            ended, _ = await asyncio.wait(under_way, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                number = under_way.pop(task)
                try:
                    task.result()
                except NoAnswer as error:
                    window.fail(number, monotonic_ns())
                    # only silence of all blocks ends it: single failures are normal on a lossy link
                    if monotonic_ns() - window.arrived_ns > give_up_s * 1e9:
                        raise NoAnswer(f"no block has passed for {give_up_s:g} s ({error})") from error
                    session.out.detail(f"block {number}: {error}; again")
                else:
                    window.acknowledge(number, monotonic_ns())
                    progress.advance()
    finally:
        for task in under_way:
            task.cancel()
        await asyncio.gather(*under_way, return_exceptions=True)
