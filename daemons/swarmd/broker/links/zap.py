"""Authenticator of ZeroMQ connections: answers libzmq's requests from the roster (RFC 27, ZAP)."""

import asyncio
import ipaddress
import logging
from typing import Final

import zmq

from swarmd.broker.links.zmq_socket import Socket, ZmqSocket
from swarmware.transport.security.keys import Keys
from swarmware.types.net import Refused

DOMAIN: Final = "swarm"
COMPLAINTS: Final = 100
"""Unknown keys that are logged, each once; all denied handshakes are counted."""
_ENDPOINT: Final = "inproc://zeromq.zap.01"
_VERSION: Final = b"1.0"
_PARTS: Final = 7
"""Parts of a CURVE request: version, request, domain, address, identity, mechanism, key."""

log = logging.getLogger("swarm.broker")


class Zap:
    """The authenticator of one ZeroMQ context.

    Runs on the event loop: a blocked loop delays handshakes, but accepts none. `zmq.auth` of pyzmq is not
    used: its provider decides by the key only, but a node without keys decides by the address; the
    User-Id needs a subclass of it; and its task ends with the first error, after which it denies all
    connections.
    """

    def __init__(
        self, context: zmq.Context[Socket], loop: asyncio.AbstractEventLoop, keys: Keys, refused: Refused
    ) -> None:
        self._keys = keys
        self._refused = refused
        self.users: set[str] = set()
        """User-Ids of the connections that were accepted since the socket was bound."""
        self._complained: set[bytes] = set()
        socket = context.socket(zmq.REP)
        socket.setsockopt(zmq.LINGER, 0)
        socket.bind(_ENDPOINT)
        self._port = ZmqSocket(socket, loop, self._answer)

    def _answer(self, socket: Socket) -> None:
        try:
            parts = socket.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return
        request = parts[1] if len(parts) > 1 else b""
        user = self._judge(parts)
        if user is None:
            reply = [_VERSION, request, b"400", b"not on the roster", b"", b""]
        else:
            reply = [_VERSION, request, b"200", b"OK", user.encode(), b""]
        socket.send_multipart(reply)

    def _judge(self, parts: list[bytes]) -> str | None:
        """User-Id of the connection, the member's key; None: denied."""
        if len(parts) != _PARTS or parts[0] != _VERSION or parts[5] != b"CURVE":
            return None
        address, key = parts[3].decode("ascii", "replace"), parts[6]
        if parts[2] != DOMAIN.encode():
            return None
        if self._keys.is_open:
            return "" if _is_loopback(address) else None
        member = self._keys.by_curve(key)
        if member is None:
            former = self._keys.revoked(key)
            self._refused.revoked += bool(former)
            if key not in self._complained and len(self._complained) < COMPLAINTS:
                self._complained.add(key)
                reason = f"{former} was revoked" if former else "its key is not on the roster"
                log.warning("connection from %s denied: %s", address, reason)
            return None
        self.users.add(member.user)
        return member.user

    def close(self) -> None:
        """Stops answering: no further connection is accepted."""
        self._port.close()


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False
