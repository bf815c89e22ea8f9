"""ZeroMQ on the event loop: the context, a socket, and the events of its connections."""

import asyncio
import contextlib
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

import zmq

Socket = zmq.Socket[bytes]
TURN: Final = 64
"""Messages processed before control returns to the event loop."""
POLLIN: Final = int(zmq.POLLIN)
POLLOUT: Final = int(zmq.POLLOUT)
"""As plain numbers: an operator of an enumeration takes ten times as long."""
IO_NICE: Final = -10
"""Nice value of libzmq's own threads, where the host allows one below zero."""
_THREADS: Final = Path("/proc/self/task")

_EVENT: Final = struct.Struct("=HI")
"""Number and value of an event; pyzmq's parser of it imports `zmq.asyncio`. Source: zmq_socket_monitor(3)."""

EVENTS: Final = (
    zmq.EVENT_CONNECTED
    | zmq.EVENT_ACCEPTED
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)


def make_context(max_sockets: int) -> zmq.Context[Socket]:
    """A context with one I/O thread that is scheduled ahead of the Python code of busy processes.

    A frame passes one of these threads at each end; otherwise it would wait for the busy processes.
    """
    context: zmq.Context[Socket] = zmq.Context(io_threads=1)
    context.set(zmq.MAX_SOCKETS, max_sockets)
    before = set(_THREADS.iterdir())
    context.socket(zmq.PAIR).close(0)  # libzmq starts its threads with the first socket
    for thread in set(_THREADS.iterdir()) - before:
        # without CAP_SYS_NICE or RLIMIT_NICE the priority stays unchanged: frames are only slower under load
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, int(thread.name), IO_NICE)
    return context


class ZmqSocket:
    """Watches a socket's descriptor and serves the socket in bounded turns.

    The descriptor is readable while libzmq has commands for this thread, not while there are messages: after
    each message the socket's events are queried, which processes the commands.
    """

    def __init__(
        self,
        socket: Socket,
        loop: asyncio.AbstractEventLoop,
        on_wake: Callable[[Socket], None],
        wants: Callable[[], int] | None = None,
    ) -> None:
        """`on_wake` receives one message, or sends; `wants`: POLLOUT while something waits to be sent, for
        sockets that send."""
        self.socket = socket
        self.is_closed = False
        """Whether a handler has closed the socket."""
        self._loop = loop
        self._on_wake = on_wake
        self._wants = wants
        self._coming = False
        self._fd = int(socket.getsockopt(zmq.FD))
        loop.add_reader(self._fd, self._turn)
        self.again()

    def again(self) -> None:
        """Schedules a check of the socket in the next iteration of the loop."""
        if not self._coming:
            self._coming = True
            self._loop.call_soon(self._turn)

    def _turn(self) -> None:
        self._coming = False
        events, on_wake, wanted = self.socket.getsockopt, self._on_wake, self._wants
        for _ in range(TURN):
            if self.is_closed:
                return
            on_wake(self.socket)
            if self.is_closed or not int(events(zmq.EVENTS)) & (POLLIN if wanted is None else wanted()):
                return
        self.again()

    def close(self) -> None:
        """Stops watching and closes the socket."""
        if not self.is_closed:
            self.is_closed = True
            self._loop.remove_reader(self._fd)
            self.socket.close(linger=0)


class ConnectionMonitor:
    """Connection events of one socket: `on_event(event, value)`."""

    def __init__(
        self, socket: Socket, loop: asyncio.AbstractEventLoop, on_event: Callable[[int, int], None]
    ) -> None:
        self._watched = socket
        self._on_event = on_event
        monitor = socket.get_monitor_socket(EVENTS)
        self._port = ZmqSocket(monitor, loop, self._take)

    def _take(self, monitor: Socket) -> None:
        try:
            parts = monitor.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return
        self._on_event(*_EVENT.unpack(parts[0]))

    def close(self) -> None:
        """Stops watching; call it before the watched socket is closed."""
        if not self._watched.closed:
            self._watched.disable_monitor()
        self._port.close()
