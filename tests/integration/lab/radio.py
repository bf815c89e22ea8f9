"""A node of a lab with a radio, joined by a test, and orders to the radio."""

import asyncio
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

from tests.patience import PATIENCE_S

from swarmctl.session.labs import LabState
from swarmware.module.module import Module
from swarmware.types.net import Neighbours, NeighbourState

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]


@asynccontextmanager
async def at(
    lab: LabState, platform: str
) -> AsyncIterator[tuple[Module, Callable[[str, str], Awaitable[NeighbourState]]]]:
    """Joins a node; gives a wait until its neighbour has a state."""
    async with Module("probe", config_dir=lab.node(platform).config_dir) as module:
        board = module.reader("net/neighbours", Neighbours)

        async def until(neighbour: str, state: str) -> NeighbourState:
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    for one in (board.value or Neighbours()).neighbours:
                        if one.platform == neighbour and one.state == state:
                            return one
                    await board.changed()

        yield module, until


async def order(ctl: Ctl, *words: str) -> None:
    await asyncio.to_thread(ctl, "lab", *words)
