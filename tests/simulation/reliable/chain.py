"""Messages over a chain of reliable links in virtual time, acknowledged end to end as applications do."""

from functools import partial

from tests.simulation.reliable.radio_link import MS, SESSION, Medium, S

from swarmd.broker.config import Config
from swarmd.broker.core.frames.carrier_choice import LinkQuality
from swarmd.broker.core.frames.reliable.link_action import DeliverFrame, SendPacket
from swarmd.broker.core.frames.reliable.reliable_link import OVERHEAD
from swarmd.broker.core.frames.reliable.reliable_links import Action, ReliableLinks
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmware.model.frame import Frame, FrameKind, decode, encode
from swarmware.testing.virtual import VirtualTime
from swarmware.transport.delivery import outbox
from swarmware.transport.delivery.answer import answer
from swarmware.transport.delivery.outbox import Complete, Outbox, Transmit
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types import registry
from swarmware.types.rpc import Ack


class Chain:
    """Nodes 1 to n in a line. Node 1 sends messages, node n acknowledges each of them."""

    def __init__(self, hops: int, seed: int, loss: float, *, delay_ms: float = 10.0) -> None:
        self._time = VirtualTime(S)
        self._last = hops + 1
        self._nodes = {node: ReliableLinks(Config()) for node in range(1, hops + 2)}
        self._media = {
            (node, node + step): Medium(1000 * node + 10 * seed + step, loss=loss, delay_ms=delay_ms)
            for node in self._nodes
            for step in (-1, 1)
            if node + step in self._nodes
        }
        self._drivers = {
            node: self._time.drive(links, partial(self._perform, node)) for node, links in self._nodes.items()
        }
        for node, next_node in self._media:
            self._nodes[node].on_quality(next_node, LinkQuality(loss, round(2 * delay_ms * MS)), S)
        self._outbox = Outbox(1)
        self._sender = self._time.drive(self._outbox, self._on_outbox)
        self._sent_ns: dict[outbox.Key, int] = {}
        self.told: list[tuple[float, Outcome]] = []
        """Time in ms until the sender knew the outcome of each message, and the outcome."""
        self.arrived: dict[int, int] = {}
        """Copies of each message at the last node."""

    @property
    def repeated_bytes(self) -> int:
        """Bytes that the links sent again."""
        return sum(link.repeated_bytes for node in self._nodes.values() for link in node.links())

    def send(self, size: int, timeout_s: float = 10.0) -> None:
        """Send a message from the first node to the last one."""
        now_ns = self._time.now_ns
        number = len(self._sent_ns)
        frame = Frame(
            FrameKind.MESSAGE, 1, 1, 1, self._last, 1, sequence=number, stamp_ns=now_ns, payload=bytes(size)
        )
        self._sent_ns[Outbox.key(frame)] = now_ns
        self._sender.feed(self._outbox.on_submit(frame, round(timeout_s * S), now_ns))

    def run(self, duration_s: float, period_ms: int, size: int) -> None:
        """Send messages at a fixed period, and wait for all outcomes."""
        end_ns = self._time.now_ns + round(duration_s * S)
        while self._time.now_ns < end_ns:
            self.send(size)
            self._time.run_until(self._time.now_ns + period_ms * MS)
        self._time.run_until(end_ns + 11 * S)

    def _on_outbox(self, action: outbox.Action) -> None:
        match action:
            case Transmit(frame):
                self._forward(1, frame)
            case Complete(key, outcome):
                self.told.append(((self._time.now_ns - self._sent_ns[key]) / MS, outcome))

    def _forward(self, node: int, frame: Frame) -> None:
        via = node + (1 if frame.receiver_hw > node else -1)
        now_ns = self._time.now_ns
        queued = QueuedFrame(encode(frame), frame, now_ns)
        self._drivers[node].feed(self._nodes[node].on_frame(via, SESSION, queued, now_ns))

    def _perform(self, node: int, action: Action) -> None:
        match action:
            case SendPacket(hw, _, data):
                at_ns = self._media[node, hw].arrival_ns(len(data) + OVERHEAD, self._time.now_ns)
                if at_ns is not None:
                    self._time.at(at_ns, partial(self._arrive, hw, node, data))
            case DeliverFrame(_, data):
                self._deliver(node, decode(data))

    def _arrive(self, node: int, sender: int, data: bytes) -> None:
        actions = self._nodes[node].on_packet(sender, SESSION, data, None, self._time.now_ns)
        self._drivers[node].feed(actions)

    def _deliver(self, node: int, frame: Frame) -> None:
        if frame.receiver_hw != node:
            self._forward(node, frame)
        elif frame.kind is FrameKind.ACK:
            key = (frame.receiver_app, frame.data_id, frame.sequence)
            ack = registry.decode(Ack, frame.payload, frame.codec)
            self._sender.feed(self._outbox.on_ack(key, ack, self._time.now_ns))
        else:
            self.arrived[frame.sequence] = self.arrived.get(frame.sequence, 0) + 1
            self._forward(node, answer(frame, Status.DELIVERED, where="last", stamp_ns=self._time.now_ns))
