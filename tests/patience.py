"""How a test waits for an event: as long as it takes, and where nothing announces it by repeated looks."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Final, TypeVar

import msgspec

from swarmware.errors import SwarmError
from swarmware.module.board import BoardReader

T = TypeVar("T")
V = TypeVar("V", bound=msgspec.Struct)

PATIENCE_S: Final = 60.0
"""Of a computer that is busy with other tests. What a test proves never depends on it: it only ends the wait
for an event that does not come."""

_LOOK_S: Final = 0.002
_ASK_S: Final = 0.02


async def until(find: Callable[[], T], what: str = "the event") -> T:
    """The first true result; for files, logs and other processes, which announce no change.

    Raises: TimeoutError naming `what`.
    """
    end_s = time.monotonic() + PATIENCE_S
    while not (found := find()):
        if time.monotonic() > end_s:
            raise TimeoutError(f"{what}: not within {PATIENCE_S} s")
        await asyncio.sleep(_LOOK_S)
    return found


async def until_answer(ask: Callable[[], Awaitable[T]], right: Callable[[T], bool] = lambda _: True) -> T:
    """The first answer that is right; a service that starts, or starts again, may refuse meanwhile.

    Raises: TimeoutError.
    """
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                if right(answer := await ask()):
                    return answer
            except SwarmError:
                pass
            await asyncio.sleep(_ASK_S)


async def until_value(board: BoardReader[V], right: Callable[[V], bool]) -> V:
    """The first value of a board that is right."""
    async with asyncio.timeout(PATIENCE_S):
        while board.value is None or not right(board.value):
            await board.changed()
    return board.value
