"""The UDP ports of a session with a standard receiver: RTP on an even one, RTCP on the next."""

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
    """The way to another platform: datagrams of the broker, relayed and never repeated."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.send = send

    def close(self) -> None:
        """There is nothing to close."""


class RtpSocket:
    """Both sockets, and the address of the receiver."""

    def __init__(self, family: int, host: str, port: int, on_report: Callable[[bytes], None]) -> None:
        """Raises: InvalidInput when no pair of ports is free."""
        self._to = {False: (host, port), True: (host, port + 1)}
        self._on_report = on_report
        self._loop = asyncio.get_running_loop()
        self._sockets = dict(zip((False, True), _bound_pair(family), strict=True))
        """By whether it is for RTCP."""
        self.unsent = 0
        """Packets that the system did not take."""
        for sock in self._sockets.values():
            self._loop.add_reader(sock.fileno(), self._on_readable, sock)

    def send(self, data: bytes) -> None:
        """Send a packet, RTP or RTCP."""
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
            except OSError:  # nothing more, or the receiver's port is closed
                return
            if address[0] == self._to[True][0]:
                self._on_report(data)

    def close(self) -> None:
        """Close both of its sockets."""
        for sock in self._sockets.values():
            self._loop.remove_reader(sock.fileno())
            sock.close()


async def resolve(host: str, port: int) -> tuple[int, str]:
    """Family and numeric address of a host. Raises: InvalidInput for an unknown one."""
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
            pass  # the next port is in use: another pair
        for sock in pair:
            sock.close()
    raise InvalidInput("video: no two neighbouring UDP ports are free")
