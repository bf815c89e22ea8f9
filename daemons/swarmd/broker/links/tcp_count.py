"""Bytes on the wire of libzmq's TCP connections, from the kernel's counters (TCP_INFO)."""

import os
import socket
import stat
import struct
from typing import Final

HALF_OPEN_MAX: Final = 128
"""Limit of connections without a presented key; members need milliseconds for it, and open two each."""
SHOWN_BYTES: Final = 400
"""ZMTP's greeting (64 bytes) and CURVE's HELLO (202) are less, with INITIATE (260 at least), which has the
key, it is more. Source: RFC 23 and 26 of ZeroMQ."""
_TCP_INFO_BYTES: Final = 256
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


class TcpCount:
    """Counters of libzmq's connections; their descriptors are read, never kept or closed."""

    def __init__(self) -> None:
        self._inodes: dict[int, int] = {}
        self._last: dict[int, tuple[int, int, int]] = {}
        self._new: set[int] = set()
        self.sent_bytes = 0
        self.received_bytes = 0
        self.shut = 0
        """Connections that were closed because too many had not presented a key."""

    def add(self, fd: int) -> None:
        """Starts counting a connection."""
        inode = _socket_inode(fd)
        if inode is not None:
            self._inodes[fd] = inode
            self._last[fd] = (0, 0, 0)
            self.sample(fd)

    def accept(self, fd: int) -> None:
        """Counts an incoming connection; closes it where too many have not presented a key yet."""
        self.add(fd)
        if fd not in self._inodes:
            return
        if len(self._new) >= HALF_OPEN_MAX:
            self._new = {one for one in self._new if self.sample(one) and self._last[one][2] < SHOWN_BYTES}
        if len(self._new) < HALF_OPEN_MAX:
            self._new.add(fd)
            return
        self.shut += 1
        sock = socket.socket(fileno=fd)
        try:
            sock.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # the peer has closed it
        finally:
            sock.detach()  # it belongs to libzmq, which will see the end and close it

    def sample_all(self) -> None:
        """Updates the counters of all connections; closed ones keep their values."""
        for fd in list(self._inodes):
            if not self.sample(fd):
                del self._inodes[fd], self._last[fd]

    def sample(self, fd: int) -> bool:
        """Updates the counters of one connection; False when it is closed."""
        if _socket_inode(fd) != self._inodes.get(fd):
            return False
        moved = _moved_bytes(fd)
        if moved is None:
            return False
        before = self._last[fd]
        self.sent_bytes += moved[0] - before[0]
        self.received_bytes += moved[1] - before[1]
        self._last[fd] = moved
        return True


def _socket_inode(fd: int) -> int | None:
    try:
        found = os.fstat(fd)
    except OSError:
        return None
    return found.st_ino if stat.S_ISSOCK(found.st_mode) else None


def _moved_bytes(fd: int) -> tuple[int, int, int] | None:
    """Bytes sent and received with IP and TCP headers, acknowledgements and repetitions, and those received
    without them; None: not a TCP connection."""
    sock = None
    try:
        # its kind given, the kernel is not asked for it; only TCP sockets have TCP_INFO
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP, fileno=fd)
        info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
    except OSError:
        return None
    finally:
        if sock is not None:
            sock.detach()  # it belongs to libzmq
    received, segments_out, segments_in = _BYTES_RECEIVED.unpack_from(info)
    # Linux before 4.19 does not report the bytes sent, only those received
    sent = (_BYTES_SENT if len(info) >= _BYTES_SENT.size else _BYTES_ACKED).unpack_from(info)[0]
    header = _HEADERS + (_TIMESTAMP_BYTES if info[_OPTIONS_AT] & _TIMESTAMPS else 0)
    arrived = received + segments_in * header + _SYN_BYTES
    return sent + segments_out * header + _SYN_BYTES, arrived, received
