"""Events of the links to neighbours: a protocol for each receiver."""

from typing import Protocol

from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmware.model.frame import Frame
from swarmware.types.net import LinkTransport


class ConnectionFrames(Protocol):
    """Frames over connections, as the router of frames takes them."""

    def on_connection_frame(self, data: bytes, user: str, /) -> None:
        """Takes an encoded frame, and the platform at the other end, or "" without authentication."""
        ...

    def on_roster_frame(self, data: bytes, user: str, host: str, /) -> None:
        """Takes an encoded frame of kind ROSTER, the platform and the address at the other end."""
        ...

    def on_unknown_key(self, name: str, reason: str, /) -> None:
        """Takes the address, or the name of a revoked platform, and the reason of a denied handshake."""
        ...

    def on_sent(self, peer: LinkPeer, size: int, frame: Frame, /) -> None:
        """Takes a frame that a connection has accepted, and its bytes."""
        ...


class ConnectionEvents(ConnectionFrames, Protocol):
    """Events of the connections to all neighbours."""

    def on_undelivered(self, peer: LinkPeer, frames: list[QueuedFrame], /) -> None:
        """Takes the frames that a connection to a neighbour has given up."""
        ...

    def on_waiting(self, peer: LinkPeer, /) -> None:
        """Takes the neighbour for whose connection frames wait."""
        ...


class DatagramFrames(Protocol):
    """Frames in datagrams, as the router of frames takes them, and the neighbours that may send them."""

    def excludes(self, hw: int, /) -> bool:
        """Whether the roster excludes this node."""
        ...

    def find_peer(self, hw: int, /) -> LinkPeer | None:
        """Endpoint and keys of a neighbour, or None for any other node."""
        ...

    def on_datagram_frame(self, data: bytes, peer: LinkPeer, /) -> None:
        """Takes the frame of a datagram, and the neighbour that sealed it."""
        ...

    def on_begun(self, peer: LinkPeer, frame: Frame, /) -> None:
        """Takes a frame whose first transmission was a datagram."""
        ...


class DatagramEvents(DatagramFrames, Protocol):
    """Events of the datagrams from and to all neighbours."""

    def on_packet(self, data: bytes, peer: LinkPeer, arrived_ns: int, /) -> None:
        """Takes the packet of a datagram, the neighbour that sealed it, and its arrival on the own clock."""
        ...

    def on_unsent(self, peer: LinkPeer, frame: Frame, /) -> None:
        """Takes a frame that a datagram could not carry."""
        ...


class LinkEvents(ConnectionFrames, DatagramFrames, Protocol):
    """Events of all links, for the router of frames."""

    def on_given_up(self, peer: LinkPeer, transport: LinkTransport, frames: list[QueuedFrame], /) -> None:
        """Takes the frames that a link to a neighbour has given up."""
        ...
