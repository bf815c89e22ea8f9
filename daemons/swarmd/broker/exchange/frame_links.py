"""Frames to neighbours: over a connection where the link is clean, in datagrams where it loses packets."""

import asyncio
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.frames.carrier import LinkQuality
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
from swarmd.broker.core.swarm.media.medium_table import Use
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.traffic import Counters
from swarmd.broker.exchange.frame_datagrams import FrameDatagrams, NeighbourMedia
from swarmd.broker.exchange.link_events import LinkEvents
from swarmd.broker.exchange.zmq_links import ZmqLinks
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.pair_seal import PairEnd
from swarmware.errors import ConfigError, WireError
from swarmware.model.clock import Clock
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.runtime.driver import CoreDriver
from swarmware.transport.security.keys import Keys
from swarmware.types.net import ConnectionStatus, LinkTraffic, LinkTransport

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
        # bound here, because a method of its own would cost a call for each frame
        self.excludes = events.excludes
        self.find_peer = events.find_peer
        self.on_connection_frame = events.on_connection_frame
        self.on_roster_frame = events.on_roster_frame
        self.on_unknown_key = events.on_unknown_key
        self.on_sent = events.on_sent
        self.on_datagram_frame = events.on_datagram_frame
        self.on_begun = events.on_begun
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
            self._datagrams = FrameDatagrams(
                config,
                keys,
                own,
                clock,
                counters,
                self._connections.port,
                ways,
                self,
            )
        except ConfigError:
            self._connections.close()
            raise
        self._counted: dict[int, tuple[int, int, int]] = {}
        """Of each reliable link: its session, repeated bytes and arrived frames when last counted."""
        self._core = ReliableLinks(config)
        self._driver = CoreDriver(
            self._core, self._perform, name="links", clock=clock, loop=asyncio.get_running_loop()
        )

    @property
    def tcp_port(self) -> int:
        """Port of the connections."""
        return self._connections.port

    @property
    def frame_port(self) -> int:
        """UDP port of the datagrams."""
        return self._datagrams.port

    def prepare(self, peer: LinkPeer) -> None:
        """Derives the keys of the pair with a neighbour, before the first datagram needs them."""
        self._datagrams.prepare(peer)

    def connected(self) -> list[LinkPeer]:
        """The neighbours with connections, open or not."""
        return self._connections.peers()

    def on_roster(self) -> None:
        """The keys have another roster."""
        self._datagrams.on_roster()
        self._connections.drop_revoked()

    def send_once(self, peer: LinkPeer, frame: Frame, data: bytes | None) -> bool:
        """Sends the first transmission of a frame in a datagram of its own; False: use `send`.

        `data`: the frame as it was encoded. One that is not urgent goes so only where nearly nothing is lost,
        by one medium, and before no other frame.
        """
        if not frame.is_urgent:
            is_clean = self._ways is None and self._core.is_clean(peer.hw)
            if not is_clean or self._connections.waiting(peer.hw)[0]:
                return False
        elif self._core.uses_datagrams(peer.hw) and not self._has_several(peer):
            return False  # its reliable link sends it at once, and again if it is lost
        if not self._datagrams.send(peer, frame, data):
            return False
        self._counters.link(peer.platform, LinkTransport.UDP).offered_frames += 1
        return True

    def send_unrepeated(self, peer: LinkPeer, frame: Frame) -> bool:
        """Sends a frame in a datagram of its own, whatever the link; False: it cannot be sent so."""
        return self._datagrams.send_unrepeated(peer, frame)

    def on_repeated(self, hw: int, frame: Frame) -> None:
        """A frame that may begin as a datagram is repeated to a neighbour."""
        self._datagrams.on_repeated(hw, frame)

    def on_unsent(self, peer: LinkPeer, frame: Frame) -> None:
        """Sends or queues a frame that a datagram could not carry."""
        self.send(peer, encode(frame), frame)

    def send(self, peer: LinkPeer, data: bytes, frame: Frame) -> None:
        """Sends or queues a frame for a neighbour."""
        by_datagram = self._by_datagram(peer, frame)
        transport = LinkTransport.UDP if by_datagram else LinkTransport.TCP
        self._counters.link(peer.platform, transport).offered_frames += 1
        if by_datagram:
            self._send_datagrams(peer, QueuedFrame(data, frame, self._clock.now_ns()))
            return
        gone = self._connections.send(peer, data, frame)
        if gone:
            self.on_undelivered(peer, gone)

    def on_undelivered(self, peer: LinkPeer, frames: list[QueuedFrame]) -> None:
        """Refuses the frames that a connection has given up."""
        self._events.on_given_up(peer, LinkTransport.TCP, frames)

    def on_waiting(self, peer: LinkPeer) -> None:
        """Measures the connection for which frames wait."""
        self._driver.feed(self._core.on_waiting(peer.hw, self._clock.now_ns()))

    def _measure_connection(self, hw: int) -> None:
        delay, is_waiting = self._connections.delay(hw), bool(self._connections.waiting(hw)[0])
        self._driver.feed(self._core.on_connection(hw, delay, is_waiting, self._clock.now_ns()))

    def _has_several(self, peer: LinkPeer) -> bool:
        return self._ways is not None and len(self._ways.ways(peer.hw, Use.URGENT)) > 1

    def _by_datagram(self, peer: LinkPeer, frame: Frame) -> bool:
        if not peer.host:
            return True  # no medium to it has connections
        return bool(peer.frame_port) and self._core.uses_datagrams(peer.hw) and not _needs_connection(frame)

    def _send_datagrams(self, peer: LinkPeer, queued: QueuedFrame) -> None:
        now_ns = self._clock.now_ns()
        self._driver.feed(self._core.on_frame(peer.hw, peer.session, queued, now_ns))

    def on_datagram(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        """Takes a datagram that came by a medium beside the main network."""
        self._datagrams.on_arrival(medium, arrival)

    def on_medium(self, hw: int) -> None:
        """The medium of the packets to a neighbour has changed: what waits for connections follows."""
        peer = self.find_peer(hw)
        if peer is not None and not peer.host:
            for queued in self._connections.disconnect(hw):
                self._send_datagrams(peer, queued)

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Context manager: queues frames and sends them together when it ends."""
        with self._connections.batch(), self._datagrams.batch():
            yield

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
            is_opening = self._connections.state(hw) is ConnectionStatus.CONNECTING
            known = msgspec.structs.replace(quality, is_opening=is_opening)
            self._driver.feed(self._core.on_quality(hw, known, now_ns))

    def disconnect(self, hw: int) -> list[QueuedFrame]:
        """Ends the links to a lost neighbour; returns the frames that have not arrived."""
        return self._core.on_gone(hw, self._clock.now_ns()) + self._connections.disconnect(hw)

    def update_counters(self) -> None:
        """Brings the traffic counters of the links up to date."""
        count, counters = self._connections.count, self._counters
        count.sample_all()
        counters.tcp_sent_bytes = count.sent_bytes
        counters.tcp_received_bytes = count.received_bytes
        counters.refused.denied_connections = self._connections.denied
        for row in counters.links.values():
            row.waiting_frames = row.waiting_bytes = 0
        for peer in self._connections.peers():
            frames, size = self._connections.waiting(peer.hw)
            _add_waiting(counters.link(peer.platform, LinkTransport.TCP), frames, size)
        for link in self._core.links():
            found = self.find_peer(link.hw)
            if found is None:
                continue
            row = counters.link(found.platform, LinkTransport.UDP)
            _add_waiting(row, len(link), link.waiting_bytes)
            session, repeated, arrived = self._counted.get(link.hw, (link.session, 0, 0))
            if session != link.session:
                repeated = arrived = 0  # a new link, which counts from 0
            row.repeated_bytes += link.repeated_bytes - repeated
            row.delivered_frames += link.arrived_frames - arrived
            self._counted[link.hw] = link.session, link.repeated_bytes, link.arrived_frames
            if link.rate.capacity_bytes_s is not None:
                row.capacity_bytes_s, row.capacity_ns = link.rate.capacity_bytes_s, link.rate.capacity_ns

    def waiting(self, hw: int) -> tuple[int, int]:
        """Frames that wait for a neighbour or have not arrived, and their bytes."""
        frames, size = self._connections.waiting(hw)
        link = self._core.link(hw)
        return (frames, size) if link is None else (frames + len(link), size + link.waiting_bytes)

    def state(self, hw: int) -> ConnectionStatus:
        """How frames travel to a neighbour."""
        peer = self.find_peer(hw)
        if self._core.uses_datagrams(hw) or (peer is not None and not peer.host):
            return ConnectionStatus.DATAGRAMS
        return self._connections.state(hw)

    def _perform(self, action: Action) -> None:
        peer = self.find_peer(action.hw)
        if peer is None:
            return
        match action:
            case SendPacket(session=session) if session == peer.session:
                self._datagrams.send_packet(peer, action.data)
            case DeliverFrame():
                self.on_datagram_frame(action.data, peer)
            case FrameBegun():
                self.on_begun(peer, action.queued.frame)
            case FramesDropped():
                self._events.on_given_up(peer, LinkTransport.UDP, action.frames)
            case MeasureConnection():
                self._measure_connection(action.hw)
            case SetBuffer():
                self._connections.limit(action.hw, action.size)
            case UseConnection():
                for queued in action.frames:
                    self.send(peer, queued.data, queued.frame)
            case UseDatagrams():
                for queued in self._connections.take_queue(action.hw):
                    self._send_datagrams(peer, queued)

    def close(self) -> None:
        """Closes all connections and the socket for frames."""
        self._driver.stop()
        self._datagrams.close()
        self._connections.close()


def _needs_connection(frame: Frame) -> bool:
    """Whether a frame proves something by its connection; checks of origins are signed."""
    if frame.kind is FrameKind.HELLO:
        return not is_check(frame.payload)
    return frame.kind is FrameKind.ROSTER


def _add_waiting(row: LinkTraffic, frames: int, size: int) -> None:
    row.waiting_frames += frames
    row.waiting_bytes += size
