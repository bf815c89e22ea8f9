"""A ZeroMQ socket on the event loop: watched, drained in bounded turns, written without waiting."""

import asyncio
import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import zmq

from swarmware.model.frame import HEADER_BYTES, PAYLOAD_LIMIT

TURN: Final = 64
"""Messages processed before control returns to the event loop: about 1 ms of handlers."""
HIGH_WATER: Final = 64
"""Messages inside libzmq per peer; the rest waits in our own queues, where it is counted."""
EXTENSION_LIMIT: Final = 255
IO_NICE: Final = -10
"""Nice value of libzmq's own threads, where the host allows one below zero."""

_THREADS: Final = Path("/proc/self/task")


def make_context(max_sockets: int | None = None) -> zmq.Context[zmq.Socket[bytes]]:
    """A context with one I/O thread that is scheduled ahead of the Python code of busy processes.

    A frame passes two of these threads; each would wait for the processor behind all computing threads.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context(io_threads=1)
    if max_sockets is not None:
        context.set(zmq.MAX_SOCKETS, max_sockets)
    before = set(_THREADS.iterdir())
    context.socket(zmq.PAIR).close(0)  # libzmq starts its threads with the first socket
    for thread in set(_THREADS.iterdir()) - before:
        # without CAP_SYS_NICE or RLIMIT_NICE the value is unchanged: only slower under load
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, int(thread.name), IO_NICE)
    return context


def make_socket(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
    """A socket with options against blocking, unbounded queues and silent drops."""
    socket = context.socket(kind)
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.SNDHWM, HIGH_WATER)
    socket.setsockopt(zmq.RCVHWM, HIGH_WATER)
    # with IMMEDIATE a disconnected DEALER drops messages that it has received but not returned yet: the last
    # acknowledgements of a process that ends (libzmq session_base.cpp, reconnect; measured)
    socket.setsockopt(zmq.IMMEDIATE, 0)
    socket.setsockopt(zmq.RECONNECT_IVL, 20)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
    socket.setsockopt(zmq.HANDSHAKE_IVL, 3000)
    socket.setsockopt(zmq.MAXMSGSIZE, PAYLOAD_LIMIT + HEADER_BYTES + EXTENSION_LIMIT)
    if kind == zmq.ROUTER:
        socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
    return socket


class Port:
    """One socket on the event loop.

    Its descriptor is edge-triggered: after every wake-up, and after every send, the socket is read until
    it is empty, or the wake-up for the remaining messages does not occur.
    """

    def __init__(
        self,
        socket: zmq.Socket[bytes],
        loop: asyncio.AbstractEventLoop,
        on_parts: Callable[[list[bytes]], None],
        on_writable: Callable[[], bool],
    ) -> None:
        """`on_writable` sends waiting messages and returns whether it sent any."""
        self.socket = socket
        self._loop = loop
        self._on_parts = on_parts
        self._on_writable = on_writable
        self._turn_comes = False
        self._fd = int(socket.getsockopt(zmq.FD))
        loop.add_reader(self._fd, self._turn)
        self.again()  # messages that arrived before the descriptor was watched

    def again(self) -> None:
        """Check the socket in the next iteration of the loop."""
        if not self._turn_comes:
            self._turn_comes = True
            self._loop.call_soon(self._turn)

    def _turn(self) -> None:
        self._turn_comes = False
        if self.socket.closed:
            return
        receive = self.socket.recv_multipart
        for _ in range(TURN):
            try:
                parts = receive(zmq.NOBLOCK)
            except zmq.Again:
                break
            except zmq.ZMQError as error:
                if error.errno == zmq.ENOTSOCK:
                    return  # a handler closed the socket
                raise
            self._on_parts(parts)
        else:
            self.again()
        if self._on_writable():
            self.again()

    def close(self, linger_ms: int = 0) -> None:
        """Close the socket; libzmq still sends its queue for `linger_ms`."""
        if not self.socket.closed:
            self._loop.remove_reader(self._fd)
            self.socket.close(linger=linger_ms)
