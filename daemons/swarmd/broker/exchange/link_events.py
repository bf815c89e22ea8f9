"""The carriers of frames as their user sees them, and their events: a protocol for each receiver."""

from typing import Protocol

from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmware.model.frame import Frame


class Carrier(Protocol):
    """The transport of frames to all neighbours: connections, or reliable datagrams."""

    def send(self, peer: LinkPeer, queued: QueuedFrame, /) -> list[QueuedFrame]:
        """Sends or queues a frame for a neighbour; returns the frames that are given up for it."""
        ...

    def waiting(self, hw: int, /) -> tuple[int, int]:
        """Frames that wait for a neighbour or have not arrived, and their bytes."""
        ...

    def take_queue(self, hw: int, /) -> list[QueuedFrame]:
        """Removes and returns the frames that wait for a neighbour; the link to it stays."""
        ...

    def disconnect(self, hw: int, /) -> list[QueuedFrame]:
        """Ends the link to a neighbour; returns the frames that wait for it."""
        ...

    def close(self) -> None:
        """Closes all links and sockets."""
        ...


class ConnectionEvents(Protocol):
    """Events of the connections to all neighbours."""

    def on_connection_frame(self, data: bytes, user: str, /) -> None:
        """Takes an encoded frame, and the platform at the other end, or "" without authentication."""
        ...

    def on_roster_frame(self, data: bytes, user: str, host: str, /) -> None:
        """Takes an encoded frame of kind ROSTER, the platform and the address at the other end."""
        ...

    def on_unknown_key(self, name: str, reason: str, /) -> None:
        """Takes the address, or the name of a revoked platform, and the reason of a denied handshake."""
        ...

    def on_taken(self, peer: LinkPeer, size: int, frame: Frame, /) -> None:
        """Takes a frame that a connection has accepted, and its bytes."""
        ...

    def on_undelivered(self, peer: LinkPeer, frames: list[QueuedFrame], /) -> None:
        """Takes the frames that a connection to a neighbour has given up."""
        ...

    def on_waiting(self, peer: LinkPeer, /) -> None:
        """Takes the neighbour for whose connection frames wait."""
        ...


class DatagramEvents(Protocol):
    """Events of the datagrams from and to all neighbours, and the neighbours that may send them."""

    def excludes(self, hw: int, /) -> bool:
        """Whether the roster excludes this node."""
        ...

    def find_peer(self, hw: int, /) -> LinkPeer | None:
        """Endpoint and keys of a neighbour, or None for any other node."""
        ...

    def on_datagram_frame(self, data: bytes, peer: LinkPeer, /) -> None:
        """Takes the frame of a datagram, and the neighbour that sealed it."""
        ...

    def on_packet(self, data: bytes, peer: LinkPeer, arrived_ns: int, /) -> None:
        """Takes the packet of a datagram, the neighbour that sealed it, and its arrival on the own clock."""
        ...

    def on_begun(self, peer: LinkPeer, frame: Frame, /) -> None:
        """Takes a frame whose first transmission was a datagram."""
        ...

    def on_unsent(self, peer: LinkPeer, frame: Frame, /) -> None:
        """Takes a frame that a datagram could not carry."""
        ...


class LinkEvents(Protocol):
    """Events of all links, for the router of frames: the carrier of a frame is not among them."""

    def excludes(self, hw: int, /) -> bool:
        """Whether the roster excludes this node."""
        ...

    def find_peer(self, hw: int, /) -> LinkPeer | None:
        """Endpoint and keys of a neighbour, or None for any other node."""
        ...

    def on_frame(self, frame: Frame, user: str, arrived_ns: int, /) -> None:
        """Takes a frame, the platform that sent it, or "" without authentication, and its arrival."""
        ...

    def on_proof(self, frame: Frame, user: str, /) -> None:
        """Takes a frame with the session of a neighbour, which only the key of this platform can send."""
        ...

    def on_roster_frame(self, frame: Frame, user: str, host: str, /) -> None:
        """Takes a message about the roster, its sender as in `on_frame`, and the sender's address."""
        ...

    def on_unknown_key(self, name: str, reason: str, /) -> None:
        """Takes the address, or the name of a revoked platform, and the reason of a denied handshake."""
        ...

    def on_sent(self, frame: Frame, /) -> None:
        """Takes a frame that a carrier has begun to send."""
        ...

    def on_given_up(self, peer: LinkPeer, frames: list[QueuedFrame], /) -> None:
        """Takes the frames that no carrier could bring to a neighbour."""
        ...

    def on_dropped(self, frame: Frame, /) -> None:
        """Takes a frame that is never repeated and could not be sent."""
        ...
