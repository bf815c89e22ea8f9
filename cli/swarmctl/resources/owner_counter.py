"""Counters of owners, for boards that arrive with the beacon, which carries no numbers."""

import asyncio

from swarmctl.resources.newest import owned
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model.names import split
from swarmware.model.resource import Kind
from swarmware.types.tree import TreeEntry, TreeValue


def is_numbered(session: Session, entry: TreeEntry) -> bool:
    """Whether values of a resource arrive at the joined node with the numbers of their owner."""
    remote = split(entry.path)[0] != session.here
    return not (remote and entry.kind is Kind.BOARD and entry.link == "tick")


async def at_owner(session: Session, path: str) -> TreeValue | None:
    """Newest value at its owner, with its number and rate there, or None without an answer."""
    try:
        return await owned(session, path)
    except SwarmError:
        return None


class OwnerCounters:
    """Readings of the counters of some resources since `begin`."""

    def __init__(self, session: Session, entries: list[TreeEntry]) -> None:
        self._session = session
        self._paths = [entry.path for entry in entries if not is_numbered(session, entry)]
        self._first: dict[str, TreeValue] = {}

    async def begin(self) -> None:
        """Reads the counters of the owners."""
        self._first = await self._read()

    async def rates_hz(self) -> dict[str, float]:
        """Rates by a second reading; resources without a new value or an answer are left out."""
        found = {}
        for path, last in (await self._read()).items():
            first = self._first.get(path)
            # a counter that fell belongs to a restarted owner, whose two readings have no common rate
            if first is not None and last.sequence > first.sequence and last.stamp_ns > first.stamp_ns:
                found[path] = (last.sequence - first.sequence) / ((last.stamp_ns - first.stamp_ns) / 1e9)
        return found

    async def _read(self) -> dict[str, TreeValue]:
        found = await asyncio.gather(*(at_owner(self._session, path) for path in self._paths))
        return {path: value for path, value in zip(self._paths, found, strict=True) if value is not None}
