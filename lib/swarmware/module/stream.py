"""The reader's end of a stream or of events: every one, in order; what was overrun is counted."""

import asyncio
from typing import Final, Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.model.names import split
from swarmware.module.immediate import Immediate
from swarmware.module.meta import Meta
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.follower import RingFollower
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

FAIR: Final = 64
"""Items taken without waiting before the event loop gets its turn."""


class StreamReader(Immediate, Generic[T]):
    """`async for item in reader`: every item from now on; those already there when the writer came before us
    are given only with `from_oldest`."""

    def __init__(self, node: Node, path: str, cls: type[T], data_id: int, *, from_oldest: bool) -> None:
        self.path = path
        self.meta: Meta | None = None
        """Who wrote the item given last, and when."""
        self._cls = cls
        self._last: tuple[int, int] | None = None
        """Of a mirror: its owner's sequence and stamp of the item given last."""
        self._gaps = 0
        platform, local = split(path)
        self._mirrored = platform is not None
        self._run = 0
        self._wakeup = Wakeup()
        self._follower = RingFollower(
            ring_file(node.shm_dir, local, platform),
            name=f"stream {path}",
            data_id=data_id,
            from_oldest=from_oldest,
        )
        self._follower.listen(node, self._wakeup.notify)

    @property
    def refused(self) -> int:
        """Frames that were damaged, of another type or of another path."""
        return self._follower.refused

    @property
    def lost(self) -> int:
        """Items that will not be given: overwritten here before they were read, or left out on the way from
        another platform, as its sequence shows with the item after them."""
        return self._gaps if self._mirrored else self._follower.lost

    def _count_gap(self, sequence: int, stamp_ns: int) -> None:
        """A sequence that goes on later than the last leaves a gap; one that does not is a new start."""
        if self._last is not None:
            last, last_ns = self._last
            if sequence > last + 1 and stamp_ns >= last_ns:
                self._gaps += sequence - last - 1
        self._last = sequence, stamp_ns

    def take(self) -> T | None:
        """The next item if there is one; does not wait."""
        while (frame := self._follower.next()) is not None:
            try:
                if self._mirrored:
                    self._count_gap(frame.sequence, frame.stamp_ns)
                value = registry.decode(self._cls, frame.payload, frame.codec)
            except WireError as error:
                self._follower.refuse(error)
                continue
            self.meta = Meta.of(frame)
            return value
        return None

    async def next(self, timeout_s: float | None = None) -> T:
        """The next item.

        Raises: NoAnswer when there is none in time.
        """
        deadline: Deadline | None = None
        while True:
            value = self.take()
            if value is not None:
                self._run += 1
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
