"""New values of one resource or of many, as they arrive."""

import asyncio
from typing import Any, Final, Self

import msgspec

from swarmctl.resources.listing import is_pattern, valued
from swarmctl.resources.values import brief, field, single
from swarmctl.session.session import Session
from swarmware.errors import Partial
from swarmware.model.resource import Kind
from swarmware.module.board import BoardReader
from swarmware.module.stream import StreamReader
from swarmware.types import registry
from swarmware.types.tree import TreeEntry

QUEUE_LIMIT: Final = 1000
"""Values waiting to be printed; at the limit readers wait, and count overwritten values."""


class WatchedValue(msgspec.Struct, frozen=True):
    """One new value of a watched resource."""

    path: str
    type: str
    stamp_ns: int | None
    """Hardware clock of the owner."""
    age_s: float | None
    value: Any
    """The plain value; a single value without its Struct."""


class ResourceWatch:
    """New values: `async for new in ResourceWatch.open(session, entries)`."""

    def __init__(self) -> None:
        self._news: asyncio.Queue[WatchedValue] = asyncio.Queue(QUEUE_LIMIT)
        self._streams: list[StreamReader[Any]] = []

    @classmethod
    def open(cls, session: Session, entries: list[TreeEntry]) -> Self:
        """Subscribes to the resources.

        Raises: NotFound for a type that is not known here.
        """
        watch = cls()
        for entry in entries:
            found = registry.find(entry.type)
            if entry.kind in {Kind.EVENT, Kind.STREAM}:
                stream = session.module.stream_reader(entry.path, found)
                watch._streams.append(stream)
                session.module.start(watch._every(entry, stream, session), f"watch {entry.path}")
            else:
                board = session.module.reader(entry.path, found)
                session.module.start(watch._newest(entry, board), f"watch {entry.path}")
        return watch

    async def _newest(self, entry: TreeEntry, board: BoardReader[Any]) -> None:
        async for value in board:
            await self._news.put(
                WatchedValue(entry.path, entry.type, board.stamp_ns, board.age_s, single(value))
            )

    async def _every(self, entry: TreeEntry, stream: StreamReader[Any], session: Session) -> None:
        async for value in stream:
            meta = stream.meta
            stamp_ns = None if meta is None else meta.stamp_ns
            local_ns = stamp_ns
            if meta is not None and meta.sender_hw != session.module.node.hardware:
                local_ns = session.module.remote_clocks.to_local(meta.sender_hw, meta.stamp_ns)
            age_s = None if local_ns is None else (session.module.now_ns() - local_ns) / 1e9
            await self._news.put(WatchedValue(entry.path, entry.type, stamp_ns, age_s, single(value)))

    @property
    def lost(self) -> int:
        """Items of streams that were overwritten before they were read."""
        return sum(stream.lost for stream in self._streams)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> WatchedValue:
        return await self._news.get()


async def print_changes(session: Session, path: str, count: int | None) -> None:
    """Prints each new value of the resources, or of a field of them; ends after `count`, when one is given.

    Raises: Partial when values were overwritten before they were read.
    """
    name, _, fields = path.partition(".")
    watch = ResourceWatch.open(session, await valued(session, name))
    printed = 0
    async for new in watch:
        value = field(new.value, new.path, fields)
        if session.settings.structured:
            session.out.line(msgspec.structs.replace(new, value=value))
        else:
            session.out.now(f"{new.path}  {brief(value)}" if is_pattern(name) else brief(value))
        printed += 1
        if printed == count:
            break
    if watch.lost:
        raise Partial(f"{name}: {watch.lost} values were overwritten before they were read")
