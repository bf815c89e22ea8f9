"""The UDP ports of a session with a standard receiver: RTP on an even port, RTCP on the next port."""

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Any, Final

from swarmd.video.core import rtp_packet
from swarmware.errors import InvalidInput

DATAGRAM_MAX: Final = 2048
ATTEMPTS: Final = 20
TURN: Final = 64

log = logging.getLogger("swarm.video")


class SwarmPath:
    """Path to another platform by datagrams of the broker, which are relayed but not retransmitted."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.send = send

    def close(self) -> None:
        """Does nothing, because the broker's datagrams need no socket."""


class RtpSocket:
    """Both sockets of a session with a standard receiver."""

    def __init__(self, family: int, host: str, port: int, on_report: Callable[[bytes], None]) -> None:
        """Raises: InvalidInput when no pair of ports is free."""
        self._to = {False: (host, port), True: (host, port + 1)}
        self._on_report = on_report
        self._loop = asyncio.get_running_loop()
        self._sockets = dict(zip((False, True), _bound_pair(family), strict=True))
        """Sockets by purpose, True for RTCP and False for RTP."""
        self.unsent = 0
        """Number of packets that the operating system refused."""
        for sock in self._sockets.values():
            self._loop.add_reader(sock.fileno(), self._on_readable, sock)

    def send(self, data: bytes) -> None:
        """Sends an RTP or RTCP packet from its port."""
        is_rtcp = rtp_packet.is_rtcp(data)
        try:
            self._sockets[is_rtcp].sendto(data, self._to[is_rtcp])
        except OSError as error:
            self.unsent += 1
            log.debug("video to %s: %s", self._to[is_rtcp], error)

    def _on_readable(self, sock: socket.socket) -> None:
        for _ in range(TURN):
            try:
                data, address = sock.recvfrom(DATAGRAM_MAX)
            except OSError:  # no further datagram, or the receiver's port is closed
                return
            # the port is not compared, because receivers may send from another port
            if address[0] == self._to[True][0]:
                self._on_report(data)

    def close(self) -> None:
        """Closes both sockets of the session."""
        for sock in self._sockets.values():
            self._loop.remove_reader(sock.fileno())
            sock.close()


async def resolve(host: str, port: int) -> tuple[int, str]:
    """Address family and numeric address of a host. Raises: InvalidInput for an unknown host."""
    try:
        found: Any = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise InvalidInput(f"receiver {host}:{port}: {error.strerror}") from error
    return int(found[0][0]), str(found[0][4][0])


def _bound_pair(family: int) -> tuple[socket.socket, socket.socket]:
    kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
    for _ in range(ATTEMPTS):
        pair = socket.socket(family, kind), socket.socket(family, kind)
        try:
            pair[0].bind(("", 0))
            port = pair[0].getsockname()[1]
            if port % 2 == 0 and port < 0xFFFF:
                pair[1].bind(("", port + 1))
                return pair
        except OSError:
            pass  # the next port is in use, so another pair is tried
        for sock in pair:
            sock.close()
    raise InvalidInput("video: no two neighbouring UDP ports are free")
