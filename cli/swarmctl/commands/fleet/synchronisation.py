"""Whether the data of nodes are synchronised with the operator's node, by the digests of their trees."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import Session, connect
from swarmware.errors import ConfigError, NoAnswer, NotFound, SwarmError
from swarmware.model import names
from swarmware.types.tree import TreeList, TreeListing

POLL_S: Final = 0.5
"""Period of the comparison: a digest that becomes equal is not an event of the joined node."""


class Synchronisation:
    """Compares the tree of each node with its replica at the operator's node."""

    def __init__(self, session: Session) -> None:
        self._session = session

    async def missing(self, platform: str) -> str:
        """Reason why the node is not synchronised, or "" if its replica has the digest of its own tree."""
        here = self._session.here
        try:
            replica = (await self._digests(here)).get(platform, 0)
            # without a replica the digest is 0, which is not compared
            if not replica:
                return f"{here} does not have its tree"
            own = (await self._digests(platform)).get(platform, 0) if platform != here else replica
        except SwarmError as error:
            return str(error)
        return "" if own == replica else f"the replica of its tree at {here} is not complete"

    async def until(self, platform: str, timeout_s: float) -> None:
        """Returns when the node is synchronised.

        Raises: NoAnswer with what is missing at the time-out.
        """
        missing = "not examined"
        try:
            async with asyncio.timeout(timeout_s):
                while True:
                    missing = await self.missing(platform)
                    if not missing:
                        return
                    await asyncio.sleep(POLL_S)
        except TimeoutError:
            raise NoAnswer(f"runs, but is not synchronised within {timeout_s:g} s: {missing}") from None

    async def _digests(self, at: str) -> Mapping[str, int]:
        """Digests of the trees that a node knows, by platform."""
        nothing = TreeList(f"/{at}/none", 1)
        path = names.join(at, "sys/tree/list")
        found = await self._session.module.request(path, nothing, TreeListing, timeout_s=1.0)
        return {one.platform: one.digest for one in found.platforms}


@asynccontextmanager
async def synchronisation(settings: CliSettings) -> AsyncIterator[Synchronisation | None]:
    """The comparison through the operator's node, or None if no node runs on this machine.

    Raises: as `connect` when a node was named and cannot be joined.
    """
    async with AsyncExitStack() as stack:
        try:
            session = await stack.enter_async_context(connect(settings))
        except (NotFound, NoAnswer, ConfigError):
            # a node that was named must be there, while the default one is optional
            if settings.config or settings.lab:
                raise
            yield None
        else:
            yield Synchronisation(session)
