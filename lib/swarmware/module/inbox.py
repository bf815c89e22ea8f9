"""The inbox: messages to one address, each exactly once, acknowledged when it is put in here."""

import asyncio
from collections import deque
from typing import Final, Generic, TypeVar

import msgspec

from swarmware.errors import NoAnswer, WireError
from swarmware.model.frame import Frame
from swarmware.module.accepted import Accepted
from swarmware.module.immediate import Immediate
from swarmware.module.meta import Meta
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.node import Node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

LIMIT: Final = 64
"""Messages that wait for their reader; while it is full, senders try again until their time is over."""
FAIR: Final = 64
"""Messages taken without waiting before the event loop gets its turn."""


class Inbox(Immediate, Generic[T]):
    """`async for message in inbox`."""

    def __init__(
        self, node: Node, app: str, path: str, cls: type[T], limit: int, accepted: Accepted | None = None
    ) -> None:
        self.path = path
        self.meta: Meta | None = None
        """Who sent the message given last, and when."""
        self.refused = 0
        """Messages whose payload did not fit the type; their senders were told."""
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
        """A message came; called by the post. None: no room now."""
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
        """The next message if there is one; does not wait."""
        if not self._queue:
            return None
        value, self.meta = self._queue.popleft()
        return value

    async def next(self, timeout_s: float | None = None) -> T:
        """The next message.

        Raises: NoAnswer when there is none in time.
        """
        deadline = Deadline(timeout_s)
        while True:
            value = self.take()
            if value is not None:
                self._run += 1
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
