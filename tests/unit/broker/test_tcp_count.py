"""Connections without a proven key compete for a limited number of places."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from swarmd.broker.sockets.zmq.tcp_count import HALF_OPEN_MAX, PROVEN_BYTES, TcpCount


class Server:
    """A listening socket that accepts as libzmq does, and the clients that connected."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._listening = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

    def connection(self, address: str = "127.0.0.1") -> tuple[socket.socket, socket.socket]:
        """A new connection from this address: client's end, server's end."""
        client = self._stack.enter_context(socket.socket())
        client.bind((address, 0))
        client.settimeout(5)
        client.connect(self._listening.getsockname())
        return client, self._stack.enter_context(self._listening.accept()[0])


@pytest.fixture
def server() -> Iterator[Server]:
    with ExitStack() as stack:
        yield Server(stack)


def is_shut(client: socket.socket) -> bool:
    """Whether the server ended the connection."""
    client.setblocking(False)
    try:
        return client.recv(1) == b""
    except BlockingIOError:
        return False


def test_oldest_excess_connection_without_key_is_shut(server: Server) -> None:
    count = TcpCount()
    clients = []
    for _ in range(HALF_OPEN_MAX + 10):
        client, accepted = server.connection()
        clients.append(client)
        count.accept(accepted.fileno())
    assert [is_shut(client) for client in clients] == [True] * 10 + [False] * HALF_OPEN_MAX
    assert count.half_open() == HALF_OPEN_MAX


def test_excess_connections_are_shut_per_address(server: Server) -> None:
    count = TcpCount()
    member, accepted = server.connection("127.0.0.2")
    count.accept(accepted.fileno())
    for _ in range(2 * HALF_OPEN_MAX):
        _, accepted = server.connection("127.0.0.3")
        count.accept(accepted.fileno())
    assert not is_shut(member)


def test_what_a_client_sends_proves_no_key(server: Server) -> None:
    count = TcpCount()
    liar, accepted = server.connection()
    liar.sendall(bytes(10_000))
    count.accept(accepted.fileno())
    for _ in range(HALF_OPEN_MAX):
        _, other = server.connection()
        count.accept(other.fileno())
    assert is_shut(liar)


def test_client_after_handshake_keeps_its_connection(server: Server) -> None:
    count = TcpCount()
    member, accepted = server.connection()
    count.accept(accepted.fileno())
    accepted.sendall(bytes(PROVEN_BYTES))
    assert member.recv(PROVEN_BYTES, socket.MSG_WAITALL) == bytes(PROVEN_BYTES)
    for _ in range(2 * HALF_OPEN_MAX):
        _, other = server.connection()
        count.accept(other.fileno())
    assert not is_shut(member)
    assert count.half_open() == HALF_OPEN_MAX


def test_outgoing_connection_with_reused_descriptor_is_never_shut(server: Server) -> None:
    count = TcpCount()
    _, accepted = server.connection()
    fd = accepted.fileno()
    count.accept(fd)
    client, outgoing = server.connection()
    accepted.close()
    with socket.socket(fileno=outgoing.detach()) as moved:
        reused = moved.fileno() if moved.fileno() == fd else socket.dup(moved.fileno())
        assert reused == fd, "the lowest free descriptor"
        count.add(fd)
        for _ in range(2 * HALF_OPEN_MAX):
            _, other = server.connection()
            count.accept(other.fileno())
        assert not is_shut(client)
        if reused != moved.fileno():
            socket.close(reused)
