"""The reader's end of a board: the newest value, and its age."""

import logging
from typing import Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.frame import decode
from swarmware.module.meta import Meta
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.source import Source
from swarmware.module.wakeup import Deadline
from swarmware.names import split
from swarmware.node import Node
from swarmware.shm.layout import ring_file
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

log = logging.getLogger("swarm.module")


class BoardReader(Generic[T]):
    """The newest value of a resource, here or mirrored from another platform.

    It may be opened before there is a writer. `async for value in reader` gives each value that was the
    newest when it was asked for.
    """

    def __init__(
        self, node: Node, path: str, cls: type[T], data_id: int, remote_clocks: RemoteClocks
    ) -> None:
        self.path = path
        self.refused = 0
        """Frames that were of another type, or damaged."""
        self._cls = cls
        self._data_id = data_id
        self._node = node
        self._remote_clocks = remote_clocks
        platform, local = split(path)
        self._source = Source(node, ring_file(node.shm_dir, local, platform))
        self._value: T | None = None
        self._meta: Meta | None = None
        self._at = -1
        self._source.open()

    @property
    def value(self) -> T | None:
        """The newest value; None as long as there was none."""
        source = self._source
        ring = source.ring
        if ring is not None and source.before + ring.sequence == self._at and not ring.moved:
            return self._value
        return self._take()

    def _take(self) -> T | None:
        ring = self._source.ring
        if ring is None or ring.moved:
            ring = self._source.open()
            if ring is None:
                return self._value
        before = self._source.before
        self._at = before + ring.sequence
        try:
            data = ring.newest()
            if data is None:
                return self._value
            self._at = before + ring.seen
            frame = decode(data)
            if frame.data_id != self._data_id:
                raise WireError(f"of another type than {self._cls.__name__}, or of another path")
            self._value = registry.decode(self._cls, frame.payload, frame.codec)
            self._meta = Meta.of(frame)
        except WireError as error:
            self.refused += 1
            if self.refused == 1:  # the count tells the rest
                log.warning("board %s: refused: %s", self.path, error)
        return self._value

    @property
    def meta(self) -> Meta | None:
        """Who wrote the newest value, and when."""
        self.value  # noqa: B018 - a look at the ring first
        return self._meta

    @property
    def stamp_ns(self) -> int | None:
        """Writer's hardware clock at the newest value."""
        meta = self.meta
        return None if meta is None else meta.stamp_ns

    @property
    def sequence(self) -> int:
        """Writer's sequence of the newest value; 0: none yet."""
        meta = self.meta
        return 0 if meta is None else meta.sequence

    @property
    def age_s(self) -> float | None:
        """Time since the newest value was stamped; None without one, or its clock is unknown."""
        meta = self.meta
        if meta is None:
            return None
        stamp_ns: int | None = meta.stamp_ns
        if meta.sender_hw != self._node.hardware:
            stamp_ns = self._remote_clocks.to_local(meta.sender_hw, meta.stamp_ns)
        return None if stamp_ns is None else (self._node.clock.now_ns() - stamp_ns) / 1e9

    @property
    def alive(self) -> bool:
        """Whether somebody writes this board now."""
        ring = self._source.ring if self._source.ring is not None else self._source.open()
        return ring is not None and not ring.moved and ring.owner_alive()

    async def changed(self, timeout_s: float | None = None) -> T:
        """The next value that `value` or `changed` has not given yet.

        Raises: NoAnswer when there is none in time.
        """
        deadline = Deadline(timeout_s)
        self._source.listen()
        while True:
            if self._news():
                at, meta = self._at, self._meta
                value = self._take()
                if value is not None and self._at != at and self._meta is not meta:
                    return value
            if not await self._source.wait(deadline):
                raise NoAnswer(f"board {self.path}: no new value within {timeout_s} s")

    def _news(self) -> bool:
        ring = self._source.ring
        return ring is None or ring.moved or self._source.before + ring.sequence != self._at

    def listen(self) -> None:
        """Have this process woken by each value, also when nobody waits for it here."""
        self._source.listen()

    @property
    def position(self) -> int:
        """Counts the values, read or not: a larger number when there is news; -1: there was no writer yet."""
        ring = self._source.ring
        if ring is None or ring.moved:
            ring = self._source.open()
        return -1 if ring is None else self._source.before + ring.sequence

    def __aiter__(self) -> "BoardReader[T]":
        return self

    async def __anext__(self) -> T:
        return await self.changed()

    def close(self) -> None:
        """Stop reading."""
        self._source.close()
