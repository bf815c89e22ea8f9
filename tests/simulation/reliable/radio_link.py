"""Two ends of a reliable link in virtual time, and a medium with loss, delay, jitter, rate and queue."""

import random
from collections.abc import Callable
from functools import partial

from swarmd.broker.config import Config
from swarmd.broker.core.frames.carrier_choice import LinkQuality
from swarmd.broker.core.frames.reliable.link_action import DeliverFrame, FramesDropped, SendPacket
from swarmd.broker.core.frames.reliable.reliable_link import OVERHEAD, ReliableLink
from swarmd.broker.core.frames.reliable.reliable_links import Action, ReliableLinks
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmware.model.frame import Frame, FrameKind, decode, encode
from swarmware.runtime.driver import CoreDriver
from swarmware.testing.virtual import VirtualAlarm, VirtualClock, VirtualTime

MS = 1_000_000
S = 1_000_000_000
SESSION = 7


class Medium:
    """One direction: a queue in front of a rate, then loss, delay and jitter."""

    def __init__(
        self,
        seed: int,
        *,
        loss: float = 0.0,
        delay_ms: float = 10.0,
        jitter_ms: float = 0.0,
        rate_bit_s: float = 50e6,
        queue_bytes: float = 256_000,
    ) -> None:
        self.random = random.Random(seed)
        self.loss = loss
        self.delay_ns = round(delay_ms * MS)
        self.jitter_ns = round(jitter_ms * MS)
        self.rate_bit_s = rate_bit_s
        self.queue_bytes = queue_bytes
        self.free_ns = 0
        self.queueing: list[tuple[int, int]] = []
        """Instant and queueing delay of each datagram."""
        self.is_cut = False

    def arrival_ns(self, size: int, now_ns: int) -> int | None:
        """Arrival of a datagram of this size, or None if it is lost."""
        wait_ns = max(0, self.free_ns - now_ns)
        self.queueing.append((now_ns, wait_ns))
        if wait_ns * self.rate_bit_s / 8e9 > self.queue_bytes:
            return None
        self.free_ns = now_ns + wait_ns + round(size * 8e9 / self.rate_bit_s)
        if self.is_cut or self.random.random() < self.loss:
            return None
        return self.free_ns + self.delay_ns + round(self.random.random() * self.jitter_ns)


class Processor:
    """The event loop of a process that other programs keep from its processor.

    When it has nothing to do, and something becomes due, it may wait first; what becomes due meanwhile is
    handled with it.
    """

    def __init__(self, time: VirtualTime, seed: int, stall_ms: tuple[float, float], share: float) -> None:
        """`share`: of the wake-ups that wait, for a random time between the two of `stall_ms`."""
        self._time = time
        self._random = random.Random(seed)
        self._stall_ms = stall_ms
        self._share = share
        self._free_ns = 0

    def run(self, call: Callable[[], None]) -> None:
        """Calls it when the process has the processor."""
        now_ns = self._time.now_ns
        if now_ns >= self._free_ns and self._random.random() < self._share:
            self._free_ns = now_ns + round(self._random.uniform(*self._stall_ms) * MS)
        if now_ns < self._free_ns:
            self._time.at(self._free_ns, call)
        else:
            call()

    def call_later(self, delay: float, callback: Callable[[], None], /) -> VirtualAlarm:
        """Schedules an event that can be cancelled, as an event loop does."""
        alarm = VirtualAlarm(callback)
        self._time.after(delay, lambda: self.run(alarm))
        return alarm


class Pair:
    """Node 1 and node 2, each with its end of the link."""

    def __init__(
        self,
        there: Medium,
        back: Medium,
        loss: float = 0.0,
        *,
        stall_ms: tuple[float, float] = (0.0, 0.0),
        stalled: float = 0.0,
    ) -> None:
        """`stalled`: share of the wake-ups of each node that wait for its processor."""
        self._time = VirtualTime(S)
        self._processors = {node: Processor(self._time, node, stall_ms, stalled) for node in (1, 2)}
        clock = VirtualClock(self._time)
        self._media = {1: there, 2: back}
        self._links = {node: ReliableLinks(Config()) for node in (1, 2)}
        self._drivers = {
            node: CoreDriver[Action](
                links,
                partial(self._perform, node),
                name="links",
                clock=clock,
                loop=self._processors[node],
            )
            for node, links in self._links.items()
        }
        for node, links in self._links.items():
            links.on_quality(3 - node, LinkQuality(loss), S)
        self.received: dict[int, list[tuple[int, Frame]]] = {1: [], 2: []}
        """What arrived at each node, and when."""
        self.dropped: list[Frame] = []
        self.sent = 0

    @property
    def now_ns(self) -> int:
        """The present instant."""
        return self._time.now_ns

    def end(self, node: int) -> ReliableLink:
        """End of the link at a node, which exists after the first frame that it sent or received."""
        link = self._links[node].link(3 - node)
        assert link is not None
        return link

    def at(self, when_ns: int, call: Callable[[], None]) -> None:
        """Schedule a call."""
        self._time.at(when_ns, call)

    def every(self, period_ns: int, until_ns: int, call: Callable[[], object]) -> None:
        """Call periodically, now for the first time."""

        def again() -> None:
            call()
            if self.now_ns + period_ns <= until_ns:
                self.at(self.now_ns + period_ns, again)

        self.at(self.now_ns, again)

    def run(self, until_ns: int) -> None:
        """Run until an instant."""
        self._time.run_until(until_ns)

    def send(self, size: int, kind: FrameKind = FrameKind.STREAM, sender: int = 1) -> Frame:
        """Send a frame with a payload of this size; its stamp is the present instant."""
        self.sent += 1
        now_ns = self.now_ns
        payload = bytes(size)
        frame = Frame(kind, 1, sender, 1, 3 - sender, 1, sequence=self.sent, stamp_ns=now_ns, payload=payload)
        queued = QueuedFrame(encode(frame), frame, now_ns)
        self._drivers[sender].feed(self._links[sender].on_frame(3 - sender, SESSION, queued, now_ns))
        return frame

    def _perform(self, node: int, action: Action) -> None:
        match action:
            case SendPacket():
                at_ns = self._media[node].arrival_ns(len(action.data) + OVERHEAD, self.now_ns)
                if at_ns is not None:
                    self.at(at_ns, partial(self._arrive, 3 - node, action.data))
            case DeliverFrame():
                self.received[node].append((self.now_ns, decode(action.data)))
            case FramesDropped():
                self.dropped += [one.frame for one in action.frames]

    def _arrive(self, node: int, data: bytes) -> None:
        arrived_ns = self.now_ns

        def take() -> None:
            actions = self._links[node].on_packet(3 - node, SESSION, data, arrived_ns, self.now_ns)
            self._drivers[node].feed(actions)

        self._processors[node].run(take)


def latencies_ms(received: list[tuple[int, Frame]]) -> list[float]:
    """Time from sending to delivery of each frame, sorted."""
    return sorted((at_ns - frame.stamp_ns) / MS for at_ns, frame in received)
