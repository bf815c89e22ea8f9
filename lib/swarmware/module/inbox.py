"""The inbox: messages to one address, each exactly once, acknowledged when they enter it."""

import asyncio
from collections import deque
from typing import Final, Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.model.frame import Frame
from swarmware.module.accepted import Accepted
from swarmware.module.meta import Meta
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.node import Node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

LIMIT: Final = 64
"""Maximum waiting messages; while it is full, senders retransmit until their time-out."""
FAIR: Final = 64
"""Messages taken without waiting before control returns to the event loop."""


class Inbox(Generic[T]):
    """Messages to one address, read with `async for message in inbox`."""

    def __init__(
        self, node: Node, app: str, path: str, cls: type[T], limit: int, accepted: Accepted | None = None
    ) -> None:
        self.path = path
        self.meta: Meta | None = None
        """Sender and stamp of the message returned last."""
        self.refused = 0
        """Messages whose payload did not match the type; they were refused to their senders."""
        self._node = node
        self._where = f"{node.platform}:{app}"
        self._cls = cls
        self._limit = limit
        self._accepted = accepted
        self._queue: deque[tuple[T, Meta]] = deque()
        self._wakeup = Wakeup()
        self._run = 0

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, frame: Frame) -> Outcome | None:
        """Take a received message, from the router, or return None if the inbox is full."""
        # before decoding, which a full inbox would do for nothing
        if len(self._queue) >= self._limit:
            return None
        try:
            value = registry.decode(self._cls, frame.payload, frame.codec)
        except WireError as error:
            self.refused += 1
            return Outcome(Status.REFUSED, self._where, str(error))
        self._queue.append((value, Meta.of(frame)))
        if self._accepted is not None:
            self._accepted.take(frame)
        self._wakeup.notify()
        return Outcome(Status.DELIVERED, self._where, received_ns=self._node.clock.now_ns())

    def take(self) -> T | None:
        """Return the next message without waiting, or None without a message."""
        if not self._queue:
            return None
        value, self.meta = self._queue.popleft()
        return value

    async def next(self, timeout_s: float | None = None) -> T:
        """Wait for the next message.

        Raises: NoAnswer when none arrives within the time-out.
        """
        deadline = Deadline(timeout_s)
        while True:
            value = self.take()
            if value is not None:
                self._run += 1
                # A full queue never suspends this task: without a pause the rest of the process would
                # starve.
                if self._run >= FAIR:
                    self._run = 0
                    await asyncio.sleep(0)
                return value
            self._run = 0
            if not await self._wakeup.until(deadline):
                raise NoAnswer(f"inbox {self.path}: no message within {timeout_s} s")

    def __aiter__(self) -> "Inbox[T]":
        return self

    async def __anext__(self) -> T:
        return await self.next()
