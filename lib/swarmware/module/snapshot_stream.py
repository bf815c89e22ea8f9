"""Stream with snapshots: after a gap the state of its owner, then the items after it."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, NotFound
from swarmware.module.stream import StreamReader
from swarmware.module.wakeup import Deadline
from swarmware.transport.delivery.resync import StreamResync
from swarmware.types import registry
from swarmware.types.rpc import StreamSnapshot

T = TypeVar("T", bound=msgspec.Struct)
S = TypeVar("S", bound=msgspec.Struct)

RETRY_S: Final = 0.5
"""Pause after a snapshot that was not answered, or that newer items do not follow."""


def snapshot_path(path: str) -> str:
    """The address at which the owner of a stream serves its snapshots."""
    return f"{path}_snapshot"


class SnapshotStream(Generic[T, S]):
    """`async for item in stream` returns a snapshot of the state first, then every item after it, in order.

    After a gap that was not repaired it returns a further snapshot, and continues with the items after that.
    """

    def __init__(
        self,
        reader: StreamReader[T],
        request: Callable[[], Coroutine[Any, Any, StreamSnapshot]],
        snapshot: type[S],
    ) -> None:
        self._reader = reader
        self._request = request
        self._snapshot = snapshot
        self._resync: StreamResync[T] = StreamResync()
        self.resyncs = 0
        """Snapshots that were taken."""

    @property
    def lost(self) -> int:
        """Items that did not arrive and were replaced by a snapshot."""
        return self._resync.gaps

    async def next(self, timeout_s: float | None = None) -> T | S:
        """Wait for the next item or snapshot.

        Raises: NoAnswer when none arrives within the time-out.
        """
        deadline = Deadline(timeout_s)
        while True:
            self._drain()
            # before any wait: held items follow a snapshot at once
            item = self._resync.take()
            if item is not None:
                return item
            # a gap may still be repaired by items that come late
            if not self._resync.needs_snapshot:
                self._on_item(await self._reader.next(deadline.remaining_s()))
            elif (state := await self._resynchronise()) is not None:
                return state
            elif deadline.remaining_s() == 0.0:
                raise NoAnswer(f"stream {self._reader.path}: no snapshot within {timeout_s} s")

    def _drain(self) -> None:
        while (value := self._reader.take()) is not None:
            self._on_item(value)

    def _on_item(self, value: T) -> None:
        meta = self._reader.meta
        assert meta is not None
        self._resync.on_item(meta.sequence, meta.stamp_ns, value)

    async def _resynchronise(self) -> S | None:
        try:
            found = await self._request()
        except (NoAnswer, NotFound):
            # The owner may be restarting: without a pause the requests would follow each other at once.
            await asyncio.sleep(RETRY_S)
            return None
        self._drain()
        # Items between the snapshot and the held ones are missing: a newer snapshot is requested.
        if not self._resync.on_snapshot(found.sequence, found.stamp_ns):
            return None
        self.resyncs += 1
        return registry.decode(self._snapshot, found.body)

    def __aiter__(self) -> "SnapshotStream[T, S]":
        return self

    async def __anext__(self) -> T | S:
        return await self.next()

    def close(self) -> None:
        """Stop reading the items of the owner."""
        self._reader.close()
