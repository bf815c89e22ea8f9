"""Authenticator of ZeroMQ connections: answers libzmq's requests from the roster (RFC 27, ZAP)."""

import asyncio
import ipaddress
from collections.abc import Callable
from typing import Final

import zmq

from swarmd.broker.sockets.zmq.zmq_socket import Socket, ZmqSocket
from swarmware.transport.security.keys import Keys
from swarmware.types.traffic import Refused

DOMAIN: Final = "swarm"
_ENDPOINT: Final = "inproc://zeromq.zap.01"
_VERSION: Final = b"1.0"
_PARTS: Final = 7
"""Parts of a CURVE request: version, request, domain, address, identity, mechanism, key."""

OnUnknownKey = Callable[[str, str], None]
"""Called with the address, or the name of a revoked platform, and the reason of a denied handshake."""


class Zap:
    """The authenticator of one ZeroMQ context.

    Runs on the event loop: a blocked loop delays handshakes, but accepts none. `zmq.auth` of pyzmq is not
    used: its provider decides by the key only, but a node without keys decides by the address; the
    User-Id needs a subclass of it; and its task ends with the first error, after which it denies all
    connections.
    """

    def __init__(
        self,
        context: zmq.Context[Socket],
        loop: asyncio.AbstractEventLoop,
        keys: Keys,
        refused: Refused,
        on_unknown_key: OnUnknownKey,
    ) -> None:
        self._on_unknown_key = on_unknown_key
        self._keys = keys
        self._refused = refused
        self.users: set[str] = set()
        """User-Ids of the connections that were accepted since the socket was bound."""
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
        """User-Id of the connection, which is the member's key, or None if the connection is denied."""
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
            if former:
                self._refused.revoked += 1
                self._on_unknown_key(former, f"connection from {address}: {former} was revoked")
            else:
                self._refused.unknown_keys += 1
                self._on_unknown_key(address, f"connection from {address}: its key is not on the roster")
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
