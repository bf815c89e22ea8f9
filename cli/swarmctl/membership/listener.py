"""The inviter's socket: exchanges bytes with joining nodes within limits of size, time and number."""

import asyncio
import contextlib
import errno
import socket
from collections.abc import Awaitable, Callable
from typing import Final

import msgspec

from swarmctl.membership.addresses import PORT
from swarmware.errors import Conflict
from swarmware.transport.enrolment.messages import REQUEST_MAX, SIZE_BYTES, JoinRefusal, refuse

REQUEST_S: Final = 5.0
"""Maximum time between the connection and the last byte of the request."""
CONNECTIONS_MAX: Final = 32
"""Maximum connections at a time, which is ample because a request and its answer take milliseconds."""


def listening_socket(port: int) -> socket.socket:
    """A socket on all addresses at a port; for port 0 the default port, or any free one if it is in use.

    Raises: Conflict when the given port is in use.
    """
    try:
        return _bound(port or PORT)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        if port:
            text = f"TCP port {port} is in use; expected a free one in --address HOST:PORT"
            raise Conflict(text) from error
        return _bound(0)


def _bound(port: int) -> socket.socket:
    if socket.has_dualstack_ipv6():
        return socket.create_server(("", port), family=socket.AF_INET6, dualstack_ipv6=True)
    return socket.create_server(("", port))


class WrittenAnswer(msgspec.Struct, frozen=True):
    """Answer to the request of a connection."""

    data: bytes
    confirmed: bool = False
    """Whether the node sends a receipt for the answer."""


class JoinListener:
    """Reads one request of each connection, writes the answer, and reads the receipt."""

    def __init__(
        self,
        permit: Callable[[str], bool],
        answer: Callable[[bytes, str], Awaitable[WrittenAnswer | None]],
        take_receipt: Callable[[bytes], None],
    ) -> None:
        """`permit`: whether an address may send a request; `answer`: the answer to an address's request."""
        self._permit = permit
        self._answer = answer
        self._take_receipt = take_receipt
        self._connections = 0

    async def serve(self, bound: socket.socket) -> None:
        """Serves connections until it is cancelled."""
        server = await asyncio.start_server(self._on_connection, sock=bound)
        async with server:
            await server.serve_forever()

    async def _on_connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        address = str(writer.get_extra_info("peername", ("unknown",))[0]).removeprefix(
            "::ffff:"
        )  # IPv4 on a dual-stack socket
        self._connections += 1
        try:
            if self._connections > CONNECTIONS_MAX or not self._permit(address):
                await self._write(writer, refuse(JoinRefusal.BUSY))
            elif (data := await self._read(reader)) is not None:
                found = await self._answer(data, address)
                if found is not None:
                    await self._write(writer, found.data)
                if found is not None and found.confirmed and (data := await self._read(reader)) is not None:
                    self._take_receipt(data)
        finally:
            self._connections -= 1
            writer.close()

    async def _read(self, reader: asyncio.StreamReader) -> bytes | None:
        """A request or receipt, or None if it is late or too large."""
        try:
            async with asyncio.timeout(REQUEST_S):
                size = int.from_bytes(await reader.readexactly(SIZE_BYTES), "big")
                return await reader.readexactly(size) if size <= REQUEST_MAX else None
        except (TimeoutError, asyncio.IncompleteReadError, ConnectionError):
            return None

    async def _write(self, writer: asyncio.StreamWriter, data: bytes) -> None:
        # no retry here: a node that lost the connection asks again, and gets the same answer
        with contextlib.suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(REQUEST_S):
                writer.write(len(data).to_bytes(SIZE_BYTES, "big") + data)
                await writer.drain()
