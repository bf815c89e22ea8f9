"""Virtual time and a seeded network: simulates an hour of a swarm in a second, reproducibly for each seed."""

import heapq
import random
from collections import Counter
from collections.abc import Callable, Hashable
from itertools import count
from typing import Generic, TypeVar

from swarmware.model.clock import Clock
from swarmware.runtime.core import Action, Core, HardwareClock
from swarmware.runtime.driver import CoreDriver

Name = TypeVar("Name", bound=Hashable)

Link = Callable[[Name, Name], bool]
Handler = Callable[[Name, bytes], None]


class VirtualTime:
    """Event queue: events in the order of their instants, simultaneous ones in the order of their
    scheduling."""

    def __init__(self, start_ns: int = 0) -> None:
        self.now_ns = start_ns
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    def at(self, when_ns: int, event: Callable[[], None]) -> None:
        """Schedule an event at an instant; a past one happens next."""
        # the number keeps simultaneous events in order, and events need not be comparable
        heapq.heappush(self._events, (max(when_ns, self.now_ns), next(self._order), event))

    def after(self, delay_s: float, event: Callable[[], None]) -> None:
        """Schedule an event after a delay."""
        self.at(self.now_ns + round(delay_s * 1e9), event)

    def every(self, period_s: float, event: Callable[[], None], *, first_s: float | None = None) -> None:
        """Schedule a periodic event, first after `first_s`."""

        def tick() -> None:
            self.after(period_s, tick)
            event()

        self.after(period_s if first_s is None else first_s, tick)

    def call_later(self, delay: float, callback: Callable[[], None], /) -> "VirtualAlarm":
        """Schedule an event that can be cancelled, as an event loop does."""
        alarm = VirtualAlarm(callback)
        self.after(delay, alarm)
        return alarm

    def drive(
        self,
        core: Core[Action],
        perform: Callable[[Action], None],
        *,
        clock: HardwareClock | None = None,
        settled: Callable[[], None] | None = None,
    ) -> CoreDriver[Action]:
        """Make the driver of a core, as a daemon has it; `clock`: the node's clock, if it differs from
        virtual time."""
        return CoreDriver(
            core,
            perform,
            name=type(core).__name__,
            clock=VirtualClock(self) if clock is None else clock,
            loop=self,
            settled=settled,
        )

    def step(self) -> bool:
        """Execute the next event; returns False without an event."""
        if not self._events:
            return False
        self.now_ns, _, event = heapq.heappop(self._events)
        event()
        return True

    def run_until(self, end_ns: int) -> None:
        """Execute all events up to an instant."""
        while self._events and self._events[0][0] <= end_ns:
            self.step()
        self.now_ns = max(self.now_ns, end_ns)

    def run_for(self, seconds: float) -> None:
        """Execute all events of the next seconds."""
        self.run_until(self.now_ns + round(seconds * 1e9))


class VirtualAlarm:
    """An event that can be cancelled until it happens."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback: Callable[[], None] | None = callback

    def __call__(self) -> None:
        callback, self._callback = self._callback, None
        if callback is not None:
            callback()

    def cancel(self) -> None:
        """Cancel the scheduled event."""
        self._callback = None


class VirtualClock(Clock):
    """The clock of a node in virtual time, with an offset and a drift of its own."""

    __slots__ = ("_time",)

    def __init__(self, time: VirtualTime, offset_s: float = 0.0, drift_ppm: float = 0.0) -> None:
        super().__init__(offset_s, drift_ppm)
        self._time = time

    def now_ns(self) -> int:
        """The present instant on the virtual hardware clock."""
        return self.from_mono_ns(self._time.now_ns)


class VirtualSwarm(VirtualTime, Generic[Name]):
    """A network of named nodes with loss, delay, duplication and reordering; connectivity may change.

    `delay_s`: minimum and maximum; different delays reorder datagrams. The seed determines all random
    numbers.
    """

    def __init__(
        self,
        seed: int,
        *,
        loss: float = 0.0,
        duplicate: float = 0.0,
        delay_s: tuple[float, float] = (0.001, 0.005),
        link: Link[Name] | None = None,
    ) -> None:
        super().__init__()
        self.seed = seed
        self.random = random.Random(seed)
        self.loss = loss
        self.duplicate = duplicate
        self.delay_s = delay_s
        self.link: Link[Name] = link or (lambda sender, receiver: True)
        """Whether the receiver is in range of the sender now."""
        self.counts: Counter[str] = Counter()
        """Datagrams sent, lost, duplicated, delivered; bytes sent."""
        self.sent_bytes: Counter[Name] = Counter()
        self._handlers: dict[Name, Handler[Name]] = {}

    @property
    def nodes(self) -> tuple[Name, ...]:
        """The nodes that are up."""
        return tuple(self._handlers)

    def join(self, name: Name, handler: Handler[Name]) -> None:
        """Add a node that receives datagrams with `handler(sender, data)`."""
        self._handlers[name] = handler

    def leave(self, name: Name) -> None:
        """Remove a node; datagrams in flight to it are lost."""
        self._handlers.pop(name, None)

    def send(self, sender: Name, receiver: Name, data: bytes) -> None:
        """Send a datagram to one node."""
        self.counts["sent"] += 1
        self.sent_bytes[sender] += len(data)
        self._carry(sender, receiver, data)

    def multicast(self, sender: Name, data: bytes) -> None:
        """Send a datagram to all nodes in range; each may lose it independently."""
        self.counts["sent"] += 1
        self.sent_bytes[sender] += len(data)
        for receiver in self.nodes:
            if receiver != sender:
                self._carry(sender, receiver, data)

    def _carry(self, sender: Name, receiver: Name, data: bytes) -> None:
        # before a random number is drawn: a broken link must not change the others' numbers
        if not self.link(sender, receiver):
            return
        if self.random.random() < self.loss:
            self.counts["lost"] += 1
            return
        copies = 2 if self.random.random() < self.duplicate else 1
        self.counts["duplicated"] += copies - 1
        for _ in range(copies):
            self.after(self.random.uniform(*self.delay_s), lambda: self._arrive(sender, receiver, data))

    def _arrive(self, sender: Name, receiver: Name, data: bytes) -> None:
        handler = self._handlers.get(receiver)
        if handler is not None:
            self.counts["delivered"] += 1
            handler(sender, data)
