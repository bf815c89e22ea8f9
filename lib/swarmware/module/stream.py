"""Reader of a stream or of events: every item, in order; overwritten ones are counted. Also of a board's
history: every value, in the order of arrival."""

import asyncio
from typing import Final, Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.model.names import split
from swarmware.module.meta import Meta
from swarmware.module.sequence_gaps import SequenceGaps
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.follower import RingFollower, mirror_of_platform
from swarmware.node.history_follower import HistoryFollower
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

FAIR: Final = 64
"""Items taken without waiting before control returns to the event loop."""


class StreamReader(Generic[T]):
    """`async for item in reader` returns every item from now on; items that were written before are
    returned only with `from_oldest`."""

    def __init__(
        self,
        node: Node,
        path: str,
        cls: type[T],
        data_id: int,
        *,
        from_oldest: bool = False,
        history: bool = False,
    ) -> None:
        """`history`: the resource is a board."""
        self.path = path
        self.meta: Meta | None = None
        """Sender and stamp of the item returned last."""
        self._cls = cls
        self._gaps = SequenceGaps()
        platform, local = split(path)
        self._mirrored = platform is not None and not history
        self._run = 0
        self._wakeup = Wakeup()
        self._follower = (
            HistoryFollower(node, path, data_id=data_id)
            if history
            else RingFollower(
                ring_file(node.shm_dir, local, platform),
                name=f"stream {path}",
                data_id=data_id,
                from_oldest=from_oldest,
                elsewhere=mirror_of_platform(node, path),
            )
        )
        self._follower.listen(node, self._wakeup.notify)

    @property
    def refused(self) -> int:
        """Frames that were damaged, of another type or of another path."""
        return self._follower.refused

    @property
    def lost(self) -> int:
        """Items that were lost: overwritten here before they were read, or dropped on the way from
        another platform, which a gap of its sequence shows."""
        return self._gaps.lost if self._mirrored else self._follower.lost

    def take(self) -> T | None:
        """Return the next item without waiting, or None without an item."""
        while (frame := self._follower.next()) is not None:
            try:
                if self._mirrored:
                    self._gaps.on_item(frame.sequence, frame.stamp_ns)
                value = registry.decode(self._cls, frame.payload, frame.codec)
            except WireError as error:
                self._follower.refuse(error)
                continue
            self.meta = Meta.of(frame)
            return value
        return None

    async def next(self, timeout_s: float | None = None) -> T:
        """Wait for the next item.

        Raises: NoAnswer when none arrives within the time-out.
        """
        deadline: Deadline | None = None
        while True:
            value = self.take()
            if value is not None:
                self._run += 1
                # A full ring never suspends this task: without a pause the rest of the process would
                # starve.
                if self._run >= FAIR:
                    self._run = 0
                    await asyncio.sleep(0)
                return value
            self._run = 0
            deadline = deadline or Deadline(timeout_s)
            if not await self._wakeup.until(deadline):
                raise NoAnswer(f"stream {self.path}: nothing new within {timeout_s} s")

    def __aiter__(self) -> "StreamReader[T]":
        return self

    async def __anext__(self) -> T:
        return await self.next()

    def close(self) -> None:
        """Stop reading and close the ring."""
        self._follower.close()
