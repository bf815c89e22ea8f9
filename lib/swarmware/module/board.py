"""Reader of a board: the newest value, and its age."""

from typing import Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.model.names import split
from swarmware.module.meta import Meta
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.follower import RingFollower, mirror_of_platform
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)


class BoardReader(Generic[T]):
    """The newest value of a resource of this platform, or of the mirror of another platform's.

    It may be opened before there is a writer. `async for value in reader` returns at each step the value that
    is the newest then.
    """

    def __init__(
        self, node: Node, path: str, cls: type[T], data_id: int, remote_clocks: RemoteClocks
    ) -> None:
        self.path = path
        self._cls = cls
        self._node = node
        self._remote_clocks = remote_clocks
        platform, local = split(path)
        self._follower = RingFollower(
            ring_file(node.shm_dir, local, platform),
            name=f"board {path}",
            data_id=data_id,
            elsewhere=mirror_of_platform(node, path),
        )
        self._wakeup = Wakeup()
        self._value: T | None = None
        self._meta: Meta | None = None

    @property
    def refused(self) -> int:
        """Frames that were damaged, of another type or of another path."""
        return self._follower.refused

    @property
    def value(self) -> T | None:
        """The newest value, or None before the first."""
        ring = self._follower.ring
        # one word of shared memory decides: most reads find no new value
        if ring is None or not ring.unchanged:
            self._take()
        return self._value

    def _take(self) -> bool:
        """Take the newest value; False when it was taken before."""
        frame = self._follower.newest()
        if frame is None:
            return False
        try:
            value = registry.decode(self._cls, frame.payload, frame.codec)
        except WireError as error:
            self._follower.refuse(error)
            return False
        self._value, self._meta = value, Meta.of(frame)
        return True

    @property
    def meta(self) -> Meta | None:
        """Sender and stamp of the newest value."""
        self.value  # noqa: B018 - reads the ring first
        return self._meta

    @property
    def stamp_ns(self) -> int | None:
        """Writer's hardware clock at the newest value."""
        meta = self.meta
        return None if meta is None else meta.stamp_ns

    @property
    def local_stamp_ns(self) -> int | None:
        """Own clock at the newest value, or None without a value or a known clock of its sender."""
        meta = self.meta
        if meta is None:
            return None
        # the own clock needs no conversion
        if meta.sender_hw == self._node.hardware:
            return meta.stamp_ns
        return self._remote_clocks.to_local(meta.sender_hw, meta.stamp_ns)

    @property
    def sequence(self) -> int:
        """Writer's sequence of the newest value, or 0 before the first."""
        meta = self.meta
        return 0 if meta is None else meta.sequence

    @property
    def age_s(self) -> float | None:
        """Time since the newest value was stamped, or None without a value or a known clock of its sender."""
        stamp_ns = self.local_stamp_ns
        return None if stamp_ns is None else (self._node.clock.now_ns() - stamp_ns) / 1e9

    @property
    def alive(self) -> bool:
        """Whether the board has a writer at present."""
        follower = self._follower
        if follower.position < 0:
            return False
        ring = follower.ring
        return ring is not None and not ring.moved and ring.owner_alive()

    async def changed(self, timeout_s: float | None = None) -> T:
        """Wait for a value that `value` or `changed` has not returned yet.

        Raises: NoAnswer when none arrives within the time-out.
        """
        deadline = Deadline(timeout_s)
        self.listen()
        while True:
            if self._take() and self._value is not None:
                return self._value
            if not await self._wakeup.until(deadline):
                raise NoAnswer(f"board {self.path}: no new value within {timeout_s} s")

    def listen(self) -> None:
        """Wake this process at each new value, even if no task waits for it."""
        self._follower.listen(self._node, self._wakeup.notify)

    def ring_only(self) -> None:
        """Register the doorbell of this process with the board, for a watcher of many boards."""
        self._follower.listen(self._node, None)

    @property
    def position(self) -> int:
        """Number of values written, whether read or not, or -1 before the first writer."""
        return self._follower.position

    def __aiter__(self) -> "BoardReader[T]":
        return self

    async def __anext__(self) -> T:
        return await self.changed()

    def close(self) -> None:
        """Stop reading and close the ring."""
        self._follower.close()
