"""What the kernel says of a connection of libzmq, and what it may hold."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from swarmd.broker.core.frames.send_buffer import SIZE_MIN
from swarmd.broker.sockets.zmq.tcp_socket import TcpSocket

Ends = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Ends]:
    """A connection: the client's end, and the server's."""
    with ExitStack() as stack:
        listening = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        client = stack.enter_context(socket.create_connection(listening.getsockname(), timeout=5))
        yield client, stack.enter_context(listening.accept()[0])


def test_round_trip_is_measured_before_anything_was_sent(
    pair: Ends,
) -> None:
    delay = TcpSocket(pair[0].fileno()).delay()
    assert delay is not None, "the handshake was measured"
    assert 0 < delay.min_ns <= delay.smoothed_ns


def test_the_limit_bounds_what_the_kernel_takes(pair: Ends) -> None:
    client, server = pair
    server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.setblocking(False)

    def taken() -> int:
        size = 0
        while True:
            try:
                size += client.send(bytes(1000))
            except BlockingIOError:
                return size

    TcpSocket(client.fileno()).limit(SIZE_MIN)
    assert client.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) == 2 * SIZE_MIN
    assert taken() < 200_000
    TcpSocket(client.fileno()).limit(64 * SIZE_MIN)
    assert taken() > 32 * SIZE_MIN


def test_another_socket_with_same_descriptor_is_left_alone(
    pair: Ends,
) -> None:
    client, server = pair
    fd = client.fileno()
    former = TcpSocket(fd)
    client.close()
    with (
        socket.socket(fileno=server.detach()) as other,
        socket.socket(fileno=socket.dup(other.fileno())) as new,
    ):
        assert new.fileno() == fd, "the lowest free descriptor"
        before = new.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        former.limit(SIZE_MIN)
        assert former.delay() is None
        assert new.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) == before
    former.limit(SIZE_MIN)
    assert former.delay() is None


def test_non_tcp_descriptor_has_no_round_trip() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
        assert TcpSocket(datagrams.fileno()).delay() is None
    with Path("/dev/null").open("rb") as file:
        assert TcpSocket(file.fileno()).delay() is None
