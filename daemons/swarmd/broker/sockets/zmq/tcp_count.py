"""Bytes on the wire of libzmq's TCP connections, from the kernel's counters (TCP_INFO)."""

import socket
import struct
from contextlib import suppress
from typing import Final

from swarmd.broker.sockets.zmq.tcp_socket import borrowed, socket_inode, tcp_info

HALF_OPEN_MAX: Final = 128
"""Maximum incoming connections without a proven key; a member proves its key within milliseconds, and opens
two."""
PROVEN_BYTES: Final = 272
"""Sent to a client and acknowledged by it: the greeting (64), WELCOME (170) and an ERROR (12) are less; with
READY (67), which only a client gets whose key is on the roster, it is more. What the client sends proves
nothing. Source: RFC 23 and 26 of ZeroMQ."""
_OPTIONS_AT: Final = 5
_TIMESTAMPS: Final = 1
_BYTES_RECEIVED: Final = struct.Struct("<128xQII")
"""bytes_received, segs_out, segs_in of struct tcp_info. Source: linux/tcp.h."""
_BYTES_SENT: Final = struct.Struct("<200xQ")
_BYTES_ACKED: Final = struct.Struct("<120xQ")
_HEADERS: Final = 40
"""IPv4 and TCP without options."""
_TIMESTAMP_BYTES: Final = 12
_SYN_BYTES: Final = 8
"""Options of the first segment each way, less the timestamps counted on every segment: MSS, SACK, scale."""


class HalfOpen:
    """Incoming connections that have not proven a key yet, by remote address, the oldest first."""

    def __init__(self) -> None:
        self._address: dict[int, str] = {}
        self._by_address: dict[str, dict[int, None]] = {}

    def __len__(self) -> int:
        return len(self._address)

    def add(self, fd: int, address: str) -> None:
        """Adds a connection that was accepted now."""
        self._address[fd] = address
        self._by_address.setdefault(address, {})[fd] = None

    def remove(self, fd: int) -> None:
        """Removes a connection that is closed or proven."""
        address = self._address.pop(fd, None)
        if address is not None:
            rest = self._by_address[address]
            del rest[fd]
            if not rest:
                del self._by_address[address]

    def all(self) -> list[int]:
        """The descriptors of these connections."""
        return list(self._address)

    def first(self) -> int:
        """The oldest connection of the address with the largest number: a flood displaces its own
        connections."""
        largest: dict[int, None] = max(self._by_address.values(), key=len)
        return next(iter(largest))


class TcpCount:
    """Counters of libzmq's connections; their descriptors are read, never kept or closed."""

    def __init__(self) -> None:
        self._inodes: dict[int, int] = {}
        self._last: dict[int, tuple[int, int, int]] = {}
        self._half_open = HalfOpen()
        self.sent_bytes = 0
        self.received_bytes = 0

    def add(self, fd: int) -> None:
        """Starts counting a connection."""
        self._half_open.remove(fd)  # counters of a former connection with the same descriptor
        inode = socket_inode(fd)
        if inode is not None:
            self._inodes[fd] = inode
            self._last[fd] = (0, 0, 0)
            self.sample(fd)

    def accept(self, fd: int) -> None:
        """Counts an incoming connection; where too many have not proven a key, an older one is shut for it.

        The newest is kept: a member proves its key within milliseconds, so it connects however many wait.
        """
        self.add(fd)
        address = _remote_address(fd)
        if fd not in self._inodes or address is None:
            return
        while len(self._half_open) >= HALF_OPEN_MAX:
            oldest = self._half_open.first()
            if self._is_half_open(oldest):
                _shut(oldest)
            self._half_open.remove(oldest)
        self._half_open.add(fd, address)

    def half_open(self) -> int:
        """Incoming connections that wait now to prove a key."""
        for fd in self._half_open.all():
            if not self._is_half_open(fd):
                self._half_open.remove(fd)
        return len(self._half_open)

    def _is_half_open(self, fd: int) -> bool:
        return self.sample(fd) and self._last[fd][2] < PROVEN_BYTES

    def sample_all(self) -> None:
        """Updates the counters of all connections; closed ones keep their values."""
        for fd in list(self._inodes):
            if not self.sample(fd):
                del self._inodes[fd], self._last[fd]

    def sample(self, fd: int) -> bool:
        """Updates the counters of one connection; False when it is closed."""
        if socket_inode(fd) != self._inodes.get(fd):
            return False
        moved = _moved_bytes(fd)
        if moved is None:
            return False
        before = self._last[fd]
        self.sent_bytes += moved[0] - before[0]
        self.received_bytes += moved[1] - before[1]
        self._last[fd] = moved
        return True


def _remote_address(fd: int) -> str | None:
    """Address of the peer, or None unless the descriptor is a TCP connection."""
    sock = None
    try:
        sock = socket.socket(fileno=fd)  # its family is asked
        peer = sock.getpeername()
    except OSError:  # closed meanwhile, or no connection
        return None
    finally:
        if sock is not None:
            sock.detach()  # it belongs to libzmq
    return str(peer[0]) if sock.family in (socket.AF_INET, socket.AF_INET6) else None


def _shut(fd: int) -> None:
    """Ends a connection; libzmq, to which it belongs, sees the end and closes it."""
    with suppress(OSError), borrowed(fd) as sock:  # the peer has closed it
        sock.shutdown(socket.SHUT_RDWR)


def _moved_bytes(fd: int) -> tuple[int, int, int] | None:
    """Bytes sent and received with IP and TCP headers, acknowledgements and repetitions, and the payload that
    the other end acknowledged, or None unless the descriptor is a TCP connection."""
    info = tcp_info(fd)  # only TCP sockets have it
    if info is None:
        return None
    received, segments_out, segments_in = _BYTES_RECEIVED.unpack_from(info)
    # Linux before 4.19 does not report the bytes sent, only those received
    sent = (_BYTES_SENT if len(info) >= _BYTES_SENT.size else _BYTES_ACKED).unpack_from(info)[0]
    header = _HEADERS + (_TIMESTAMP_BYTES if info[_OPTIONS_AT] & _TIMESTAMPS else 0)
    arrived = received + segments_in * header + _SYN_BYTES
    return sent + segments_out * header + _SYN_BYTES, arrived, _BYTES_ACKED.unpack_from(info)[0]
