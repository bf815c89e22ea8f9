"""The sockets of a process: a ROUTER for incoming frames, a DEALER to each other process."""

import asyncio
import contextlib
import os
from collections import deque
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

import zmq

from swarmware.errors import InvalidInput
from swarmware.transport.messaging.port import Port, make_context, make_socket
from swarmware.transport.shm.access import make_folder, share

IPC_PATH_LIMIT: Final = 107
"""Longest path of a Unix socket, without its final zero byte. Source: unix(7)."""
QUEUE_LIMIT: Final = 1024
"""Maximum frames that wait for one peer; further ones are dropped, counted, and retransmitted by
`delivery`."""
LINGER_MS: Final = 500
"""Linger time at the end of the process, to send the last acknowledgements. Only a living peer
that does not read them causes a wait."""
FORGET_S: Final = 1.0
"""Delay after the end of a process, whose last acknowledgements may still be in libzmq."""

Identity = bytes
"""Identity of a connection at our ROUTER, for answers."""


class _Peer:
    """The connection to one other process."""

    def __init__(self, wire: "Wire", endpoint: str) -> None:
        self._wire = wire
        socket = make_socket(wire.context, zmq.DEALER)
        socket.connect(endpoint)
        self._urgent: deque[bytes] = deque()
        self._queue: deque[bytes] = deque()
        self._port = Port(socket, wire.loop, self._on_parts, self._flush)

    def send(self, data: bytes, *, urgent: bool) -> bool:
        queue = self._urgent if urgent else self._queue
        if len(queue) >= QUEUE_LIMIT:
            return False
        queue.append(data)
        if self._flush():
            self._port.again()
        return True

    def _flush(self) -> bool:
        sent = False
        send = self._port.socket.send
        for queue in (self._urgent, self._queue):
            while queue:
                try:
                    send(queue[0], zmq.NOBLOCK)
                except zmq.Again:
                    return sent
                queue.popleft()
                sent = True
        return sent

    def _on_parts(self, parts: list[bytes]) -> None:
        self._wire.received(parts, None)

    @property
    def waiting(self) -> int:
        return len(self._urgent) + len(self._queue)

    def close(self, linger_ms: int = 0) -> None:
        self._port.close(linger_ms)


class Wire:
    """Sends and receives frames of the other processes of this node."""

    def __init__(self, socket_path: Path, on_data: Callable[[bytes, Identity | None], None]) -> None:
        if len(os.fsencode(socket_path)) > IPC_PATH_LIMIT:
            raise InvalidInput(
                f"{socket_path}: {len(os.fsencode(socket_path))} bytes; a socket's path has {IPC_PATH_LIMIT}"
                " at most: choose a shorter run_dir"
            )
        self.loop = asyncio.get_running_loop()
        self.context = make_context()
        self.dropped = 0
        """Frames for which a peer's queue had no room."""
        self._on_data = on_data
        self._path = socket_path
        self.endpoint = f"ipc://{socket_path}"
        self._peers: dict[str, _Peer] = {}
        self._leaving: dict[str, asyncio.TimerHandle] = {}
        make_folder(socket_path.parent, socket_path.parent.parent)
        router = make_socket(self.context, zmq.ROUTER)
        router.bind(self.endpoint)
        share(socket_path, socket_path.parent, 0o660)
        self._router = Port(router, self.loop, self._on_router_parts, _nothing_waits)

    def received(self, parts: list[bytes], identity: Identity | None) -> None:
        """One message from a socket: a frame has one part, any other message is invalid."""
        if len(parts) == 1:
            self._on_data(parts[0], identity)

    def _on_router_parts(self, parts: list[bytes]) -> None:
        self.received(parts[1:], parts[0])

    def send(self, endpoint: str, data: bytes, *, urgent: bool = False) -> bool:
        """Send to the process at the endpoint; False when its queue is full."""
        peer = self._peers.get(endpoint)
        if peer is None:
            peer = self._peers[endpoint] = _Peer(self, endpoint)
        if peer.send(data, urgent=urgent):
            return True
        self.dropped += 1
        return False

    def send_back(self, identity: Identity, data: bytes) -> bool:
        """Send on the connection of a received frame; False when it is closed or full."""
        try:
            self._router.socket.send_multipart((identity, data), zmq.NOBLOCK)
        except zmq.ZMQError as error:
            if error.errno in {zmq.EAGAIN, zmq.EHOSTUNREACH}:
                return False
            raise
        self._router.again()
        return True

    def keep_only(self, endpoints: Collection[str]) -> None:
        """Close the connections to processes that have ended, after a delay."""
        for endpoint in self._peers.keys() - self._leaving.keys() - set(endpoints):
            self._leaving[endpoint] = self.loop.call_later(FORGET_S, self._forget, endpoint)
        for endpoint in self._leaving.keys() & set(endpoints):
            self._leaving.pop(endpoint).cancel()

    def _forget(self, endpoint: str) -> None:
        del self._leaving[endpoint]
        self._peers.pop(endpoint).close()

    @property
    def waiting(self) -> int:
        """Number of frames in the queues of all peers."""
        return sum(peer.waiting for peer in self._peers.values())

    def close(self) -> None:
        """Close all sockets and remove our socket file from the run directory."""
        for timer in self._leaving.values():
            timer.cancel()
        for peer in self._peers.values():
            peer.close(LINGER_MS)
        self._peers.clear()
        self._router.close(LINGER_MS)
        self.context.term()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()


def _nothing_waits() -> bool:
    """Called when the ROUTER is writable: it has no queue."""
    return False
