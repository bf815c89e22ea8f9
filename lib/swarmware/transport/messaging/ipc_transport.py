"""The Unix sockets of a process: one listener for other processes, one connection to each receiving
process."""

import asyncio
import contextlib
import os
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

from swarmware.errors import InvalidInput, WireError
from swarmware.runtime.backoff import pause_after
from swarmware.transport.messaging.zmtp import DEALER, ROUTER, ZmtpConnection, message
from swarmware.transport.shm.access import make_folder, share
from swarmware.transport.shm.shared_file import discard

IPC_PATH_LIMIT: Final = 107
"""Longest path of a Unix socket, without its final zero byte. Source: unix(7)."""
QUEUE_LIMIT: Final = 1024
"""Maximum queued frames for one peer; further ones are dropped and counted, and `delivery` retransmits
them."""
QUEUE_BYTES: Final = 16 * 1024 * 1024
TURN: Final = 64
"""Maximum messages delivered in one iteration of the event loop: about 1 ms of handlers."""
READ_BYTES: Final = 16 * 1024
"""Bytes of one read; a buffer of this size is allocated without a system call, unlike a longer one."""
LONG_READ_BYTES: Final = 256 * 1024
"""Bytes of one read within a long message: the kernel's buffer of a connection."""
BACKLOG: Final = 128
CONNECTIONS_MAX: Final = 512
"""Maximum connections of other processes; further ones are closed at once."""
RETRY_S: Final = (0.02, 0.05, 0.1, 0.2, 0.5)
"""Pauses before the next attempt to connect; the last one from then on."""
HANDSHAKE_S: Final = 3.0
"""Time-out for the READY of a connecting process, in seconds."""
LINGER_S: Final = 0.5
"""Time for sending queued frames at the end of the process, in seconds: the acknowledgement of the last
message must still be sent. It is used up only if a living peer does not read."""
ACCEPT_PAUSE_S: Final = 1.0
"""Pause after a connection could not be accepted because no descriptor was free, in seconds."""

_SCHEME: Final = "ipc://"
_CREDENTIALS: Final = struct.Struct("=iII")
"""Process, user and group id of the other end of a Unix socket."""


class _SendQueue:
    """Queue of messages for one peer, urgent ones first; bounded in number and bytes."""

    def __init__(self) -> None:
        self._urgent: deque[bytes] = deque()
        self._normal: deque[bytes] = deque()
        self._bytes = 0
        self.waiting = 0
        """Number of messages, as an attribute: each send compares it."""

    def put(self, data: bytes, *, urgent: bool) -> bool:
        queue = self._urgent if urgent else self._normal
        if len(queue) >= QUEUE_LIMIT or self._bytes + len(data) > QUEUE_BYTES:
            return False
        queue.append(data)
        self.waiting += 1
        self._bytes += len(data)
        return True

    def pop(self) -> bytes:
        data = self._urgent.popleft() if self._urgent else self._normal.popleft()
        self.waiting -= 1
        self._bytes -= len(data)
        return data

    def clear(self) -> None:
        self._urgent.clear()
        self._normal.clear()
        self.waiting = self._bytes = 0


class IpcConnection:
    """A connection to another process; answers to messages from this connection return over it."""

    def __init__(
        self,
        transport: "IpcTransport",
        sock: socket.socket,
        socket_type: bytes,
        queue: _SendQueue,
        on_closed: "Callable[[IpcConnection], None]",
        address: str = "",
    ) -> None:
        """`address`: peer to which this process connected, or "" if the peer connected to this one."""
        self.address = address
        self._transport = transport
        self._loop = transport.loop
        self._socket = sock
        self._fd = sock.fileno()
        self.uid = _CREDENTIALS.unpack(
            sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )[1]
        """User of the other process, as the kernel knows it. Source: unix(7)."""
        self._zmtp = ZmtpConnection(socket_type)
        self._queue = queue
        self._on_closed = on_closed
        self._rest: memoryview | bytes = b""
        """Bytes of the protocol or of the last message that the kernel did not accept yet."""
        self._received: deque[bytes] = deque()
        """Received messages that are not delivered yet."""
        self._waits_for_room = False
        self._is_broken = False
        """True if the peer does not read any more; bytes that it has sent are still read."""
        self.is_closed = False
        self._loop.add_reader(self._fd, self._on_readable)
        self.flush()

    @property
    def is_ready(self) -> bool:
        """Whether messages may be sent; before the end of the handshake they are queued."""
        return self._zmtp.is_ready

    @property
    def stands(self) -> bool:
        """Whether messages go to the other process at once, as far as this one knows."""
        return self._zmtp.is_ready and not self.is_closed and not self._is_broken

    @property
    def waits(self) -> bool:
        """Whether bytes or messages wait to be sent and the peer still reads."""
        return not self.is_closed and not self._is_broken and bool(self._rest or self._queue.waiting)

    def fileno(self) -> int:
        """Descriptor of the socket."""
        return self._fd

    def send(self, data: bytes, *, urgent: bool) -> bool:
        """Send or queue a message; False when the queue is full or nothing can be sent any longer."""
        if self.is_closed or self._is_broken:
            return False
        # Behind waiting bytes a message must queue, too: written now it would overtake them or split a
        # message.
        if self._rest or self._queue.waiting or not self._zmtp.is_ready:
            return self._queue.put(data, urgent=urgent)
        self._write(message(data))
        return True

    def flush(self) -> None:
        """Send waiting bytes and messages until the kernel's buffer is full."""
        while not self._is_broken:
            if not self._rest:
                output = self._zmtp.take_output()
                if not output:
                    if not self._queue.waiting or not self._zmtp.is_ready:
                        break
                    output = message(self._queue.pop())
                self._rest = output
            self._write(self._rest)
            if self._rest:
                return  # continues when the kernel's buffer has room
        self._wait_for_room(False)

    def _write(self, data: memoryview | bytes) -> None:
        try:
            sent = self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError:
            self._is_broken = True  # the reader will see the end of the stream
            self._rest = b""
            return
        self._rest = b"" if sent == len(data) else memoryview(data)[sent:]  # a view: no copy of the rest
        if self._rest:
            self._wait_for_room(True)

    def _wait_for_room(self, wanted: bool) -> None:
        if wanted is self._waits_for_room or self.is_closed:
            return
        self._waits_for_room = wanted
        if wanted:
            self._loop.add_writer(self._fd, self.flush)
        else:
            self._loop.remove_writer(self._fd)

    def read(self) -> list[bytes] | None:
        """Read and return the complete messages in the kernel's buffer; None at the end of the stream."""
        zmtp = self._zmtp
        try:
            data = self._socket.recv(LONG_READ_BYTES if zmtp.missing > READ_BYTES else READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return []
        except OSError:  # the peer has ended: its connection is closed by the caller
            return None
        if not data:
            return None
        was_ready, ignored = zmtp.is_ready, zmtp.ignored
        try:
            messages = zmtp.receive(data)
        except WireError as error:
            self._transport.on_malformed(str(error))
            return None
        if zmtp.ignored != ignored:
            for _ in range(zmtp.ignored - ignored):
                self._transport.on_malformed("a message of several parts")
        if zmtp.has_output or not was_ready:
            self.flush()  # sends READY or PONG, and after the handshake the queued messages
        return messages

    def _on_readable(self) -> None:
        if self._received:
            return  # reading continues when these are delivered: a call for that is scheduled
        messages = self.read()
        if messages is None:
            self.close()
        elif len(messages) == 1:
            self._transport.on_data(messages[0], self)
        elif messages:
            self._received += messages
            self._deliver()

    def _deliver(self) -> None:
        """Deliver received messages, at most `TURN` in one iteration of the event loop."""
        received, on_data = self._received, self._transport.on_data
        try:
            for _ in range(min(len(received), TURN)):
                on_data(received.popleft(), self)
                if self.is_closed:
                    return
        finally:
            if received and not self.is_closed:
                self._loop.call_soon(self._deliver)

    def close(self) -> None:
        """Close the socket; bytes in the kernel's buffer still arrive."""
        if self.is_closed:
            return
        self._wait_for_room(False)
        self._loop.remove_reader(self._fd)
        self.is_closed = True
        self._received.clear()
        self._socket.close()
        self._on_closed(self)


class _IpcPeer:
    """Sends messages to one other process: connects when there is a message, and again after a failure."""

    def __init__(self, transport: "IpcTransport", address: str) -> None:
        self.queue = _SendQueue()
        self.connection: IpcConnection | None = None
        self._transport = transport
        self._address = address
        self._failures = 0
        self._retry: asyncio.TimerHandle | None = None
        self._is_leaving = False

    def send(self, data: bytes, *, urgent: bool) -> bool:
        connection = self.connection
        if connection is None and self._retry is None:
            connection = self._connect()
        if connection is not None:
            return connection.send(data, urgent=urgent)
        return self.queue.put(data, urgent=urgent)

    def _connect(self) -> IpcConnection | None:
        self._retry = None
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        sock.setblocking(False)
        try:
            # a Unix socket connects at once or fails: there is no pending state
            sock.connect(self._address.removeprefix(_SCHEME))
        except (OSError, ValueError):
            sock.close()
            self._try_again()
            return None
        self.connection = IpcConnection(
            self._transport, sock, DEALER, self.queue, self._on_closed, self._address
        )
        return self.connection

    def _try_again(self) -> None:
        self._failures += 1
        pause_s = pause_after(self._failures, RETRY_S)
        self._retry = self._transport.loop.call_later(pause_s, self._connect)

    def _on_closed(self, connection: IpcConnection) -> None:
        self.connection = None
        # Only a finished handshake ends the back-off: a process that accepts and fails would be tried at
        # once.
        if connection.is_ready:
            self._failures = 0
        if self._is_leaving:
            self._transport.forget(self._address)
        elif self.queue.waiting and not self._transport.is_closed:
            self._try_again()

    @property
    def waits(self) -> bool:
        return bool(self.queue.waiting) or (self.connection is not None and self.connection.waits)

    def keep(self) -> None:
        """Record that the process is still among the applications of the node."""
        self._is_leaving = False

    def leave(self) -> None:
        """Record that the process has left: bytes that it has sent are still read, no new connection is
        made."""
        self._is_leaving = True
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self.connection is None:
            self.queue.clear()
            self._transport.forget(self._address)

    def close(self) -> None:
        self.leave()
        if self.connection is not None:
            self.connection.close()


class IpcTransport:
    """Sends and receives messages of the other processes of this node."""

    def __init__(
        self,
        socket_path: Path,
        on_data: Callable[[bytes, IpcConnection], None],
        on_malformed: Callable[[str], None],
    ) -> None:
        """`on_malformed`: called with the reason when bytes from another process are not a message."""
        size = len(os.fsencode(socket_path))
        if size > IPC_PATH_LIMIT:
            raise InvalidInput(
                f"{socket_path}: {size} bytes; a socket's path has {IPC_PATH_LIMIT} at most:"
                " choose a shorter run_dir"
            )
        self.loop = asyncio.get_running_loop()
        self.on_data = on_data
        self.on_malformed = on_malformed
        self.dropped = 0
        """Number of frames that were dropped because the queue of a peer was full."""
        self.is_closed = False
        self.address = f"{_SCHEME}{socket_path}"
        self._path = socket_path
        self._peers: dict[str, _IpcPeer] = {}
        self._accepted: dict[IpcConnection, asyncio.TimerHandle] = {}
        self._accept_again: asyncio.TimerHandle | None = None
        self._listener, self._inode = self._listen()
        self.loop.add_reader(self._listener.fileno(), self._accept)

    def _listen(self) -> tuple[socket.socket, int]:
        """A socket that listens at the path, and the inode of its file. Raises: OSError."""
        path = self._path
        make_folder(path.parent, path.parent.parent)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listener.setblocking(False)
            discard(path)  # if it cannot be removed, `bind` says so
            listener.bind(str(path))
            share(path, path.parent, 0o660)
            listener.listen(BACKLOG)
            return listener, path.lstat().st_ino
        except OSError:
            listener.close()
            raise

    def tend(self) -> Path | None:
        """Listen again if the file of the socket was removed or replaced; its path, or None if it stands.

        Connections that stand are kept. Raises: OSError.
        """
        if self.is_closed:
            return None
        with contextlib.suppress(OSError):  # removed, or its folder
            if self._path.lstat().st_ino == self._inode:
                return None
        listener, self._inode = self._listen()
        if self._accept_again is None:
            self.loop.remove_reader(self._listener.fileno())
            self.loop.add_reader(listener.fileno(), self._accept)
        self._listener.close()
        self._listener = listener
        return self._path

    def send(self, address: str, data: bytes, *, urgent: bool = False) -> bool:
        """Send to the process at this address; False when its queue is full."""
        peer = self._peers.get(address)
        if peer is None:
            peer = self._peers[address] = _IpcPeer(self, address)
        connection = peer.connection
        if (peer if connection is None else connection).send(data, urgent=urgent):
            return True
        self.dropped += 1
        return False

    def is_connected(self, address: str) -> bool:
        """Whether a connection to the process at this address stands."""
        peer = self._peers.get(address)
        return peer is not None and peer.connection is not None and peer.connection.stands

    def keep_only(self, addresses: Collection[str]) -> None:
        """Make no new connections to other addresses; connections to ended processes close by themselves."""
        for address, peer in list(self._peers.items()):
            if address in addresses:
                peer.keep()
            else:
                peer.leave()

    def forget(self, address: str) -> None:
        """Remove the peer of a process that has left; called by the peer when it is closed."""
        self._peers.pop(address, None)

    @property
    def peers(self) -> Collection[str]:
        """Addresses of the processes with a connection or queued messages."""
        return self._peers.keys()

    @property
    def waits(self) -> bool:
        """Whether messages to any peer wait to be sent."""
        return any(peer.waits for peer in self._peers.values())

    # -- connections of other processes

    def _accept(self) -> None:
        for _ in range(TURN):
            try:
                sock, _ = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no descriptor is free: a retry at once would be a busy loop
                self.loop.remove_reader(self._listener.fileno())
                self._accept_again = self.loop.call_later(ACCEPT_PAUSE_S, self._watch_listener)
                return
            if len(self._accepted) >= CONNECTIONS_MAX:
                sock.close()
                self.on_malformed(f"more than {CONNECTIONS_MAX} connections")
                continue
            sock.setblocking(False)
            connection = IpcConnection(self, sock, ROUTER, _SendQueue(), self._on_accepted_closed)
            self._accepted[connection] = self.loop.call_later(HANDSHAKE_S, self._check, connection)

    def _watch_listener(self) -> None:
        self._accept_again = None
        self.loop.add_reader(self._listener.fileno(), self._accept)

    def _check(self, connection: IpcConnection) -> None:
        if not connection.is_ready:
            self.on_malformed(f"no READY within {HANDSHAKE_S} s")
            connection.close()

    def _on_accepted_closed(self, connection: IpcConnection) -> None:
        timer = self._accepted.pop(connection, None)
        if timer is not None:
            timer.cancel()

    # -- the end

    def close(self) -> None:
        """Close all sockets and remove the own one from the run directory."""
        if self.is_closed:
            return
        self.is_closed = True
        if self._accept_again is None:
            self.loop.remove_reader(self._listener.fileno())
        else:
            self._accept_again.cancel()
        self._listener.close()
        connections = [peer.connection for peer in self._peers.values() if peer.connection is not None]
        self._linger([*self._accepted, *connections])
        for connection in list(self._accepted):
            connection.close()
        for peer in list(self._peers.values()):
            peer.close()
        with contextlib.suppress(FileNotFoundError):
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()

    def _linger(self, connections: list[IpcConnection]) -> None:
        end_s = time.monotonic() + LINGER_S
        while waiting := [connection for connection in connections if connection.waits]:
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return
            poll = select.poll()
            by_fd = {connection.fileno(): connection for connection in waiting}
            for connection in waiting:
                # before the end of the handshake the kernel's buffer has room, and no message may be sent
                poll.register(connection.fileno(), select.POLLOUT if connection.is_ready else select.POLLIN)
            for fd, _ in poll.poll(left_s * 1000):
                if by_fd[fd].is_ready:
                    by_fd[fd].flush()
                elif by_fd[fd].read() is None:
                    by_fd[fd].close()
