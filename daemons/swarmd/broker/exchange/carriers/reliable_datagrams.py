"""Frames in datagrams that are acknowledged and repeated, over one sans-io link to each neighbour."""

from collections.abc import Callable

from swarmd.broker.core.frames.reliable.reliable_links import Action, ReliableLinks
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.traffic import Counters
from swarmd.broker.exchange.carriers.frame_datagrams import FrameDatagrams
from swarmware.model.clock import Clock
from swarmware.types.net import LinkTransport


class ReliableDatagrams:
    """The carrier for lossy links: its core decides what is sent and repeated, its socket sends."""

    def __init__(
        self,
        core: ReliableLinks,
        socket: FrameDatagrams,
        clock: Clock,
        feed: Callable[[list[Action]], None],
    ) -> None:
        """`feed`: has the actions of the core carried out."""
        self._core = core
        self._socket = socket
        self._clock = clock
        self._feed = feed

    def send(self, peer: LinkPeer, queued: QueuedFrame) -> list[QueuedFrame]:
        """Sends or queues a frame; frames that are given up are events of the link."""
        self._feed(self._core.on_frame(peer.hw, peer.session, queued, self._clock.now_ns()))
        return []

    def waiting(self, hw: int) -> tuple[int, int]:
        """Frames that wait for a neighbour or have not arrived, and their bytes."""
        link = self._core.link(hw)
        return (0, 0) if link is None else (len(link), link.waiting_bytes)

    def take_queue(self, hw: int) -> list[QueuedFrame]:
        """Removes and returns the frames that have not arrived; the link stays."""
        link = self._core.link(hw)
        return [] if link is None else link.clear(self._clock.now_ns())

    def disconnect(self, hw: int) -> list[QueuedFrame]:
        """Ends the link to a lost neighbour; returns the frames that have not arrived."""
        return self._core.on_gone(hw, self._clock.now_ns())

    def close(self) -> None:
        """Closes the socket for frames."""
        self._socket.close()

    def count(self, counters: Counters, peer_of: Callable[[int], LinkPeer | None]) -> None:
        """Adds what the links have repeated and delivered since the last call."""
        for link in self._core.links():
            peer = peer_of(link.hw)
            if peer is None:
                continue
            row = counters.link(peer.platform, LinkTransport.UDP)
            row.waiting_frames += len(link)
            row.waiting_bytes += link.waiting_bytes
            repeated_bytes, arrived_frames = link.take_counts()
            row.repeated_bytes += repeated_bytes
            row.delivered_frames += arrived_frames
            if link.rate.capacity_bytes_s is not None:
                row.capacity_bytes_s, row.capacity_ns = link.rate.capacity_bytes_s, link.rate.capacity_ns
