"""Datagrams and TCP segments as the frames of a radio, with the bytes that their headers take in the air."""

import struct
from enum import IntEnum
from typing import Final, Self

import msgspec


class PacketKind(IntEnum):
    """What a frame of the relay carries."""

    GROUP = 1
    """A datagram to the multicast group."""
    UNICAST = 2
    """A datagram to the port from which a node sends its beacons."""
    URGENT = 3
    """A datagram to the port of a node for frames."""
    SEGMENT = 4
    ACKNOWLEDGEMENT = 5


_HEADER: Final = struct.Struct(">6sBHIII")
"""Ethernet address of the receiver, kind, sender, connection, sequence, selected."""
UDP_HEADERS: Final = 42
"""Bytes of the headers of Ethernet, IPv4 and UDP."""
TCP_HEADERS: Final = 66
"""Bytes of the headers of Ethernet, IPv4 and TCP with time stamps."""


class RelayPacket(msgspec.Struct, frozen=True, gc=False):
    """What one node sends to another one, or to all, over the relay."""

    kind: PacketKind
    sender: int
    """Index of the node that sends it."""
    payload: bytes = b""
    connection: int = 0
    sequence: int = 0
    """Of a segment its number; of an acknowledgement the number of the first segment that is missing."""
    selected: int = 0
    """Of an acknowledgement: number of the segment that it answers."""

    def frame(self, address: bytes) -> bytes:
        """The frame to the node with this Ethernet address."""
        header = _HEADER.pack(address, self.kind, self.sender, self.connection, self.sequence, self.selected)
        length = TCP_HEADERS if self.kind >= PacketKind.SEGMENT else UDP_HEADERS
        return header.ljust(length, b"\0") + self.payload

    @classmethod
    def of(cls, frame: bytes) -> Self:
        """The packet in a frame that `frame` made."""
        _, number, sender, connection, sequence, selected = _HEADER.unpack_from(frame)
        kind = PacketKind(number)
        start = TCP_HEADERS if kind >= PacketKind.SEGMENT else UDP_HEADERS
        return cls(kind, sender, frame[start:], connection, sequence, selected)
