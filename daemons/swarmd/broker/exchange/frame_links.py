"""Frames to neighbours: over a connection where the link is clean, in datagrams where it loses packets."""

import asyncio
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.frames.carrier_choice import LinkQuality
from swarmd.broker.core.frames.frame_datagram import may_begin
from swarmd.broker.core.frames.reliable.link_action import (
    DeliverFrame,
    FrameBegun,
    FramesDropped,
    SendPacket,
)
from swarmd.broker.core.frames.reliable.reliable_links import (
    Action,
    MeasureConnection,
    ReliableLinks,
    SetBuffer,
    UseConnection,
    UseDatagrams,
)
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.membership.origins import is_check
from swarmd.broker.core.swarm.media.medium import MediumProfile
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.swarm.neighbours.medium_table import Use
from swarmd.broker.core.traffic import Counters
from swarmd.broker.exchange.carriers.frame_datagrams import FrameDatagrams, NeighbourMedia
from swarmd.broker.exchange.carriers.reliable_datagrams import ReliableDatagrams
from swarmd.broker.exchange.carriers.zmq_links import ZmqLinks
from swarmd.broker.exchange.link_events import Carrier, LinkEvents
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.pair_seal import PairEnd
from swarmware.errors import ConfigError, WireError
from swarmware.model.clock import Clock
from swarmware.model.frame import HOPS, HOPS_AT, Frame, FrameKind, decode, encode
from swarmware.runtime.driver import CoreDriver
from swarmware.transport.delivery.answer import ANSWERS
from swarmware.transport.security.keys import Keys
from swarmware.types.net import ConnectionStatus, LinkTransport

log = logging.getLogger("swarm.broker")


class FrameLinks:
    """The connections and the reliable links to all neighbours, and the choice between them."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        own: PairEnd,
        clock: Clock,
        counters: Counters,
        ways: NeighbourMedia | None,
        events: LinkEvents,
    ) -> None:
        """Raises: ConfigError when a port cannot be bound."""
        self._ways = ways
        self._events = events
        self._is_open = keys.is_open
        self._asked_by_datagram: set[int] = set()
        """Neighbours whose last question came in a datagram: so does the answer."""
        # bound here, because a method of its own would cost a call for each frame
        self.excludes = events.excludes
        self.find_peer = events.find_peer
        self.on_unknown_key = events.on_unknown_key
        self._clock = clock
        self._counters = counters
        self._connections = ZmqLinks(
            config,
            keys,
            asyncio.get_running_loop(),
            now_ns=clock.now_ns,
            refused=counters.refused,
            events=self,
        )
        try:
            self._socket = FrameDatagrams(
                config,
                keys,
                own,
                clock,
                counters,
                self._connections.port,
                ways,
                self,
            )
        # the sockets of ZeroMQ are open already, and this object does not exist for its owner
        except ConfigError:
            self._connections.close()
            raise
        self._core = ReliableLinks(config)
        self._driver = CoreDriver(
            self._core, self._perform, name="links", clock=clock, loop=asyncio.get_running_loop()
        )
        self._datagrams = ReliableDatagrams(self._core, self._socket, clock, self._driver.feed)
        self._carriers: tuple[Carrier, ...] = (self._connections, self._datagrams)

    @property
    def tcp_port(self) -> int:
        """Port of the connections."""
        return self._connections.port

    @property
    def frame_port(self) -> int:
        """UDP port of the datagrams."""
        return self._socket.port

    def prepare(self, peer: LinkPeer) -> None:
        """Derives the keys of the pair with a neighbour, before the first datagram needs them."""
        self._socket.prepare(peer)

    def connected(self) -> list[LinkPeer]:
        """The neighbours with connections, open or not."""
        return self._connections.peers()

    def on_roster(self) -> None:
        """The keys have another roster."""
        self._socket.on_roster()
        self._connections.drop_revoked()

    # sending

    def begin(self, peer: LinkPeer, frame: Frame, data: bytes | None, *, is_first: bool) -> None:
        """Sends a frame on its way; its first transmission may be a datagram of its own.

        `data`: the frame as it was encoded, unless it has changed since; `is_first`: it is not a
        retransmission of its sender.
        """
        if frame.kind is FrameKind.RTP:
            self._send_unrepeated(peer, frame)
            return
        if may_begin(frame):
            if not is_first:
                self._socket.on_repeated(peer.hw, frame)  # the datagram, or its answer, was lost
            elif self._send_once(peer, frame, data):
                return
        self.send(peer, frame, data)

    def _send_once(self, peer: LinkPeer, frame: Frame, data: bytes | None) -> bool:
        """Sends the first transmission of a frame in a datagram of its own; False if that is not possible.

        A frame that is not urgent goes so only where nearly nothing is lost, by one medium, and before no
        other frame.
        """
        if not frame.is_urgent:
            if frame.kind in ANSWERS and peer.hw not in self._asked_by_datagram:
                return False  # the connection that the question took is open
            is_clean = self._ways is None and self._core.is_clean(peer.hw)
            if not is_clean or self._connections.waiting(peer.hw)[0]:
                return False
        # over several media at once the urgent frame is sent on all, which a reliable link is not
        elif self._core.uses_datagrams(peer.hw) and not self._has_several(peer):
            return False  # its reliable link sends it at once, and again if it is lost
        if not self._socket.send(peer, frame, data):
            return False
        self._counters.link(peer.platform, LinkTransport.UDP).offered_frames += 1
        return True

    def _send_unrepeated(self, peer: LinkPeer, frame: Frame) -> None:
        """Sends a frame that is too late when it is repeated in a datagram of its own, whatever the link."""
        if not self._socket.send_unrepeated(peer, frame):
            self._counters.link(peer.platform, LinkTransport.UDP).dropped += 1
            self._events.on_dropped(frame)

    def on_unsent(self, peer: LinkPeer, frame: Frame) -> None:
        """Sends or queues a frame that a datagram could not carry."""
        self.send(peer, frame)

    def send(self, peer: LinkPeer, frame: Frame, data: bytes | None = None) -> None:
        """Sends or queues a frame for a neighbour, by the carrier that its link requires; `data`: as in
        `begin`."""
        if data is None or data[HOPS_AT] != frame.hops_left:
            data = encode(frame)
        self._put(peer, QueuedFrame(data, frame, self._clock.now_ns()))

    def _put(self, peer: LinkPeer, queued: QueuedFrame) -> None:
        carrier, transport = self._choose(peer, queued.frame)
        self._counters.link(peer.platform, transport).offered_frames += 1
        gone = carrier.send(peer, queued)
        if gone:
            self._on_given_up(peer, transport, gone)

    def _choose(self, peer: LinkPeer, frame: Frame) -> tuple[Carrier, LinkTransport]:
        """The carrier of a frame: its link decides, unless only one of both can carry the frame."""
        if peer.host:
            can_choose = bool(peer.frame_port) and not _needs_connection(frame)
            if not can_choose or not self._core.uses_datagrams(peer.hw):
                return self._connections, LinkTransport.TCP
        # without a host no medium to the neighbour has connections
        return self._datagrams, LinkTransport.UDP

    def _has_several(self, peer: LinkPeer) -> bool:
        return self._ways is not None and len(self._ways.ways(peer.hw, Use.URGENT)) > 1

    def on_taken(self, peer: LinkPeer, size: int, frame: Frame) -> None:
        """Counts a frame that a connection took; queued frames are not counted."""
        link = self._counters.link(peer.platform, LinkTransport.TCP)
        link.sent_frames += 1
        link.sent_bytes += size
        self._events.on_sent(frame)

    def on_begun(self, _peer: LinkPeer, frame: Frame) -> None:
        """Takes a frame whose first transmission was a datagram, which its socket has counted."""
        self._events.on_sent(frame)

    def on_undelivered(self, peer: LinkPeer, frames: list[QueuedFrame]) -> None:
        """Takes the frames that a connection has given up."""
        self._on_given_up(peer, LinkTransport.TCP, frames)

    def _on_given_up(self, peer: LinkPeer, transport: LinkTransport, frames: list[QueuedFrame]) -> None:
        self._counters.link(peer.platform, transport).dropped += len(frames)
        self._events.on_given_up(peer, frames)

    def on_waiting(self, peer: LinkPeer) -> None:
        """Measures the connection for which frames wait."""
        self._driver.feed(self._core.on_waiting(peer.hw, self._clock.now_ns()))

    def _measure_connection(self, hw: int) -> None:
        delay, is_waiting = self._connections.delay(hw), bool(self._connections.waiting(hw)[0])
        self._driver.feed(self._core.on_connection(hw, delay, is_waiting, self._clock.now_ns()))

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Context manager: queues frames and sends them together when it ends."""
        with self._connections.batch(), self._socket.batch():
            yield

    # receiving

    def on_connection_frame(self, data: bytes, user: str) -> None:
        """Takes an encoded frame of a connection, and the platform at its other end."""
        arrived_ns = self._clock.now_ns()  # read first: the receiver of an order reports it as its arrival
        frame = self._decoded(data, user)
        if frame is None:
            return
        # without keys only the first hop knows the neighbour: forwarding counts the hops of the frame down
        starts_here = not user and frame.hops_left >= HOPS
        if frame.kind is FrameKind.HELLO and not is_check(frame.payload):
            self._events.on_proof(frame, user)
        else:
            if frame.kind not in ANSWERS:
                self._asked_by_datagram.discard(frame.sender_hw)
            self._events.on_frame(frame, user, arrived_ns)
        peer = self.find_peer(frame.sender_hw) if starts_here else None
        link = self._counters.link(user or ("?" if peer is None else peer.platform), LinkTransport.TCP)
        link.received_frames += 1
        link.received_bytes += len(data)

    def on_roster_frame(self, data: bytes, user: str, host: str) -> None:
        """Takes a message about the roster from a connection."""
        frame = self._decoded(data, user)
        if frame is not None:
            self._events.on_roster_frame(frame, user, host)

    def on_datagram_frame(self, data: bytes, peer: LinkPeer) -> None:
        """Takes the frame of a datagram, and the neighbour that sealed it."""
        arrived_ns = self._clock.now_ns()
        frame = self._decoded(data, peer.platform)
        if frame is None:
            return
        user = "" if self._is_open else peer.platform
        if frame.kind is FrameKind.HELLO and not is_check(frame.payload):
            self._counters.refused.malformed += 1  # sessions are proven over connections
            return
        if frame.kind is FrameKind.ROSTER:
            # only from a neighbour without a connection; the seal of the pair has authenticated it
            self._events.on_roster_frame(frame, user, peer.host)
            return
        if frame.kind not in ANSWERS:
            self._asked_by_datagram.add(peer.hw)
        self._events.on_frame(frame, user, arrived_ns)

    def _decoded(self, data: bytes, user: str) -> Frame | None:
        self._counters.received_frames += 1
        try:
            return decode(data)
        except WireError as error:
            self._counters.refused.malformed += 1
            log.debug("frame from %s: %s", user or "loopback", error)
            return None

    def on_datagram(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        """Takes a datagram that came by a medium beside the main network."""
        self._socket.on_arrival(medium, arrival)

    def on_medium(self, hw: int) -> None:
        """The medium of the packets to a neighbour has changed: what waits for connections follows."""
        peer = self.find_peer(hw)
        if peer is not None and not peer.host:
            for queued in self._connections.disconnect(hw):
                self._datagrams.send(peer, queued)

    def on_packet(self, data: bytes, peer: LinkPeer, arrived_ns: int) -> None:
        """Takes a packet of a neighbour's reliable link."""
        try:
            actions = self._core.on_packet(peer.hw, peer.session, data, arrived_ns, self._clock.now_ns())
        except WireError as error:
            self._counters.refused.malformed += 1
            log.debug("packet of %s: %s", peer.platform, error)
            return
        self._driver.feed(actions)

    def on_qualities(self, qualities: Iterable[tuple[int, LinkQuality]]) -> None:
        """The quality of the links by neighbour, as beacons measured it in the last second."""
        now_ns = self._clock.now_ns()
        for hw, quality in qualities:
            # datagrams are kept while a connection would first have to be opened
            is_opening = self._connections.state(hw) is ConnectionStatus.CONNECTING
            known = msgspec.structs.replace(quality, is_opening=is_opening)
            self._driver.feed(self._core.on_quality(hw, known, now_ns))

    def disconnect(self, hw: int) -> list[QueuedFrame]:
        """Ends the links to a lost neighbour; returns the frames that have not arrived."""
        self._asked_by_datagram.discard(hw)
        return self._datagrams.disconnect(hw) + self._connections.disconnect(hw)

    def update_counters(self) -> None:
        """Brings the traffic counters of the links up to date."""
        count, counters = self._connections.count, self._counters
        count.sample_all()
        counters.tcp_sent_bytes = count.sent_bytes
        counters.tcp_received_bytes = count.received_bytes
        counters.refused.denied_connections = self._connections.denied
        # set again below; a link without a queue has no row that would set it to 0
        for row in counters.links.values():
            row.waiting_frames = row.waiting_bytes = 0
        for peer in self._connections.peers():
            frames, size = self._connections.waiting(peer.hw)
            row = counters.link(peer.platform, LinkTransport.TCP)
            row.waiting_frames += frames
            row.waiting_bytes += size
        self._datagrams.count(counters, self.find_peer)

    def waiting(self, hw: int) -> tuple[int, int]:
        """Frames that wait for a neighbour or have not arrived, and their bytes."""
        found = [carrier.waiting(hw) for carrier in self._carriers]
        return sum(frames for frames, _ in found), sum(size for _, size in found)

    def state(self, hw: int) -> ConnectionStatus:
        """How frames travel to a neighbour."""
        peer = self.find_peer(hw)
        if self._core.uses_datagrams(hw) or (peer is not None and not peer.host):
            return ConnectionStatus.DATAGRAMS
        return self._connections.state(hw)

    def _perform(self, action: Action) -> None:
        # the neighbour was lost between the action and its execution; its frames were returned by
        # `disconnect`
        peer = self.find_peer(action.hw)
        if peer is None:
            return
        match action:
            case SendPacket(session=session) if session == peer.session:
                self._socket.send_packet(peer, action.data)
            case DeliverFrame():
                self.on_datagram_frame(action.data, peer)
            case FrameBegun():
                self._events.on_sent(action.queued.frame)
            case FramesDropped():
                self._on_given_up(peer, LinkTransport.UDP, action.frames)
            case MeasureConnection():
                self._measure_connection(action.hw)
            case SetBuffer():
                self._connections.limit(action.hw, action.size)
            case UseConnection():
                now_ns = self._clock.now_ns()
                for queued in action.frames:
                    self._put(peer, QueuedFrame(queued.data, queued.frame, now_ns))
            case UseDatagrams():
                for queued in self._connections.take_queue(action.hw):
                    self._datagrams.send(peer, queued)

    def close(self) -> None:
        """Closes all connections and the socket for frames."""
        self._driver.stop()
        for carrier in self._carriers:
            carrier.close()


def _needs_connection(frame: Frame) -> bool:
    """Whether a frame proves something by its connection; checks of origins are signed."""
    if frame.kind is FrameKind.HELLO:
        return not is_check(frame.payload)
    return frame.kind is FrameKind.ROSTER
