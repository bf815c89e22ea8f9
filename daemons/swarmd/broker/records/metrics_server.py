"""Serves the metrics page over HTTP, to programs that collect it."""

import asyncio
import hmac
import logging
import re
import socket
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Final, cast

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.reports.metrics_page import CONTENT_TYPE
from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.types.traffic import Refused

PATH: Final = "/metrics"
HEAD_MAX: Final = 8192
"""Bytes of a request with its headers."""
REQUEST_S: Final = 5.0
"""Time for a request and its answer."""
CONNECTIONS_MAX: Final = 8
"""Connections at once: a collector has one."""

_REQUEST_LINE: Final = re.compile(rb"([A-Z]+) (\S+) HTTP/1\.[01]")
_HEADERS: Final = {
    HTTPStatus.UNAUTHORIZED: "WWW-Authenticate: Bearer\r\n",
    HTTPStatus.METHOD_NOT_ALLOWED: "Allow: GET, HEAD\r\n",
}

log = logging.getLogger("swarm.broker")


class HttpAnswer(msgspec.Struct, frozen=True):
    """Status of an answer, and whether it has a page."""

    status: HTTPStatus
    with_body: bool = True


def judge(head: bytes, token: bytes) -> HttpAnswer:
    """Answer to a request with these lines; `token`: that it must have, empty: none."""
    first, *fields = head.split(b"\r\n")
    request = _REQUEST_LINE.fullmatch(first)
    if request is None:
        return HttpAnswer(HTTPStatus.BAD_REQUEST)
    headers = {}
    for field in fields:
        name, colon, value = field.partition(b":")
        if not colon or not name.strip():
            return HttpAnswer(HTTPStatus.BAD_REQUEST)
        headers[name.strip().lower()] = value.strip()
    method, target = request[1], request[2]
    if method not in (b"GET", b"HEAD"):
        return HttpAnswer(HTTPStatus.METHOD_NOT_ALLOWED)
    with_body = method == b"GET"
    scheme, _, given = headers.get(b"authorization", b"").partition(b" ")
    is_given = scheme.lower() == b"bearer" and hmac.compare_digest(given.strip(), token)
    if token and not is_given:
        return HttpAnswer(HTTPStatus.UNAUTHORIZED, with_body)
    if target.partition(b"?")[0] != PATH.encode():
        return HttpAnswer(HTTPStatus.NOT_FOUND, with_body)
    return HttpAnswer(HTTPStatus.OK, with_body)


class HttpConnection(asyncio.Protocol):
    """One connection: a request, its answer, the end."""

    def __init__(self, server: "MetricsServer", loop: asyncio.AbstractEventLoop) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._head = b""
        self._limit = loop.call_later(REQUEST_S, self.end)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Takes an open connection; above the limit it is answered with an error at once."""
        self._transport = cast("asyncio.Transport", transport)  # the transport of uvloop is not a subclass
        self._server.connections.add(self)
        if len(self._server.connections) > CONNECTIONS_MAX:
            self._answer(b"")

    def data_received(self, data: bytes) -> None:
        """Takes a part of the request."""
        self._head += data
        head, end, _ = self._head.partition(b"\r\n\r\n")
        if end or len(self._head) > HEAD_MAX:
            self._answer(head if end else b"")

    def _answer(self, head: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(self._server.answer(head))
            self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is closed."""
        self._limit.cancel()
        self._server.connections.discard(self)

    def end(self) -> None:
        """Ends the connection without an answer."""
        self._limit.cancel()
        if self._transport is not None:
            self._transport.abort()


class MetricsServer:
    """One listening socket; every answer ends its connection."""

    def __init__(self, config: Config, page: Callable[[], str], refused: Refused) -> None:
        """`page`: makes the page; `refused`: counts requests without an answer of 200.

        Raises: ConfigError when the address or the token cannot be used.
        """
        self._page = page
        self._refused = refused
        self._token = _token(config.metrics_token_file)
        self.connections: set[HttpConnection] = set()
        address = (config.metrics_address, config.metrics_port)
        try:
            self._socket = socket.create_server(address)
        except OSError as error:
            raise ConfigError(
                f"broker: metrics_address {address[0]}, metrics_port {address[1]}: {error.strerror}"
            ) from error

    async def run(self) -> None:
        """Answers requests until it is cancelled."""
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: HttpConnection(self, loop), sock=self._socket)
        log.info("metrics: http://%s:%d%s", *self._socket.getsockname()[:2], PATH)
        try:
            await server.serve_forever()
        finally:
            for connection in tuple(self.connections):
                connection.end()
            server.close()

    def answer(self, head: bytes) -> bytes:
        """The answer to a request, or to bytes that are not a request."""
        found = (
            HttpAnswer(HTTPStatus.SERVICE_UNAVAILABLE)
            if len(self.connections) > CONNECTIONS_MAX
            else judge(head, self._token)
        )
        self._refused.scrapes += found.status is not HTTPStatus.OK
        return self._encoded(found)

    def _encoded(self, answer: HttpAnswer) -> bytes:
        status = answer.status
        body = (self._page() if status is HTTPStatus.OK else f"{status.value} {status.phrase}\n").encode()
        head = (
            f"HTTP/1.1 {status.value} {status.phrase}\r\n{_HEADERS.get(status, '')}"
            f"Content-Type: {CONTENT_TYPE if status is HTTPStatus.OK else 'text/plain; charset=utf-8'}\r\n"
            f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
        )
        return head.encode() + (body if answer.with_body else b"")

    def close(self) -> None:
        """Close the socket that listens."""
        self._socket.close()


def _token(file: str) -> bytes:
    if not file:
        return b""
    try:
        token = document.read(Path(file)).strip().encode()
    except OSError as error:
        raise ConfigError(f"broker: metrics_token_file {file}: {error.strerror}") from error
    if not token:
        raise ConfigError(f"broker: metrics_token_file {file}: it is empty; expected a token")
    return token
