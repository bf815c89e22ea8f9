"""New values of resources, as they arrive at the joined node."""

import asyncio
from typing import Any, Final, Self

import msgspec

from swarmctl.resources.classes import payload_class
from swarmctl.resources.rate_meter import Observation
from swarmctl.resources.values import decoded
from swarmctl.session.session import Session
from swarmware.model.clock import utc_ns
from swarmware.model.frame import Frame
from swarmware.model.names import split
from swarmware.model.resource import Kind
from swarmware.module.frame_reader import FrameReader
from swarmware.types.tree import TreeEntry

QUEUE_LIMIT: Final = 1000
"""Values waiting to be printed; at the limit readers wait, and count overwritten values."""
ORDERED: Final = frozenset({Kind.EVENT, Kind.STREAM})


class ValueArrival(msgspec.Struct, frozen=True):
    """One new value of a resource, not decoded."""

    entry: TreeEntry
    cls: type[msgspec.Struct] | None
    frame: Frame
    arrived_ns: int
    """Arrival on the clock of this node."""
    local_ns: int | None
    """Stamp converted to this node's clock, or None if the owner's clock is not known here."""
    bound_s: float | None
    """Error bound of the converted stamp, or None without a conversion."""
    arrived: bool = True
    """False if the value of the board is older than the subscription."""
    late: bool = False
    """True if newer values of the board arrived before this one."""

    @property
    def path(self) -> str:
        """Global path of the resource."""
        return self.entry.path

    @property
    def value(self) -> Any:
        """Plain data with field names, or the bare value of a Struct with a single field."""
        return decoded(self.cls, self.frame.payload, self.frame.codec)

    @property
    def age_s(self) -> float | None:
        """Time from the stamp of the value to its arrival here, or None if unknown."""
        return None if self.local_ns is None else (self.arrived_ns - self.local_ns) / 1e9

    @property
    def observation(self) -> Observation:
        """Counter, stamp and size, for a `RateMeter`."""
        frame = self.frame
        return Observation(frame.sequence, frame.stamp_ns, self.arrived_ns, len(frame.payload), self.age_s)


class ValueSubscription:
    """New values: `async for new in await ValueSubscription.open(session, entries)`.

    Boards begin with the present value.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._news: asyncio.Queue[ValueArrival] = asyncio.Queue(QUEUE_LIMIT)
        self._streams: list[FrameReader] = []

    @classmethod
    async def open(cls, session: Session, entries: list[TreeEntry], *, history: bool = False) -> Self:
        """Subscribes to the resources; with `history` also to every value of boards, not only the newest.

        Raises: WireError for an invalid description of a type.
        """
        opened = cls(session)
        # types first: a value that arrived before its type was known could not be decoded
        classes = [await payload_class(session, split(e.path)[0] or session.here, e.type) for e in entries]
        for entry, payload in zip(entries, classes, strict=True):
            every = entry.kind in ORDERED
            former = history and entry.kind is Kind.BOARD
            reader = session.module.frame_reader(entry.path, every=every, history=former)
            if every or former:
                opened._streams.append(reader)
            session.module.start(opened._follow(entry, payload, reader), f"watch {entry.path}")
        return opened

    async def _follow(
        self, entry: TreeEntry, payload: type[msgspec.Struct] | None, reader: FrameReader
    ) -> None:
        module = self._session.module
        # a stream begins after the subscription, a board with the value that it had before
        arrived, newest_ns = reader.every, 0
        async for frame in reader:
            now_ns = module.now_ns()
            local_ns: int | None = frame.stamp_ns
            bound_s: float | None = 0.0
            if frame.sender_hw != module.node.hardware:
                conversion = module.remote_clocks.conversion(frame.sender_hw)
                local_ns = None if conversion is None else conversion.to_local(frame.stamp_ns)
                bound_s = None if conversion is None else conversion.bound_at_ns(now_ns) / 1e9
            # the history of a board fills gaps after a loss, so older values may follow newer ones
            late = reader.history and frame.stamp_ns < newest_ns
            newest_ns = max(newest_ns, frame.stamp_ns)
            await self._news.put(
                ValueArrival(entry, payload, frame, now_ns, local_ns, bound_s, arrived, late)
            )
            arrived = True  # only the first value of a board can be older than the subscription

    def utc_ns(self, new: ValueArrival) -> int | None:
        """Stamp of a value on the wall clock of this machine."""
        return None if new.local_ns is None else utc_ns() - (self._session.module.now_ns() - new.local_ns)

    @property
    def lost(self) -> int:
        """Items of streams and histories that were overwritten before they were read, or lost on the way."""
        return sum(stream.lost for stream in self._streams)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> ValueArrival:
        return await self._news.get()
