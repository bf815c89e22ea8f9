"""The relay: sockets on loopback through which the nodes of a lab reach each other, without any rights.

What arrives at them passes the core of the radio as frames, and leaves at the node to which it was sent. A
node knows the others by addresses of the relay, and needs no settings but its own address, ports and group.
"""

import asyncio
import itertools
import logging
import socket
import struct
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Final

from swarmlab.radio.core.relay_packet import PacketKind, RelayPacket
from swarmlab.radio.ends import OnFrames
from swarmlab.radio.relay_plan import RelayPlan
from swarmlab.radio.relayed_connection import RelayedConnection
from swarmware.errors import ConfigError

TURN: Final = 64
"""Datagrams read from a socket before those of the others."""
DATAGRAM_MAX: Final = 2048
BACKLOG: Final = 16
EVERYONE: Final = b"\xff" * 6
_LOOPBACK: Final = "127.0.0.1"

log = logging.getLogger("swarm.radio")


class LoopbackRelay:
    """Sockets of all nodes of a lab, and the connections between them."""

    def __init__(self, plan: RelayPlan, ethernet: Sequence[bytes]) -> None:
        """`ethernet`: addresses of the nodes in the radio's core.

        Raises: ConfigError when an address or port is in use.
        """
        self._plan = plan
        self._ethernet = ethernet
        self._on_frames: OnFrames = lambda _sender, _frames: None
        self._connections: dict[int, RelayedConnection] = {}
        self._numbers = itertools.count(1)
        self._tasks: set[asyncio.Task[None]] = set()
        self._closing = ExitStack()
        every = range(len(ethernet))
        try:
            self._groups = [self._bound(plan.group_of(node), plan.port, group=True) for node in every]
            self._sockets = {
                (at, other, port): self._bound(plan.seen(other, at), port)
                for at, other in itertools.permutations(every, 2)
                for port in (plan.port, plan.urgent_port)
            }
            self._listeners = {
                (at, other): self._listening(plan.seen(other, at))
                for at, other in itertools.permutations(every, 2)
            }
        except BaseException:
            self.close()
            raise

    def start(self, on_frames: OnFrames) -> None:
        """Begins to take datagrams and connections from all nodes."""
        self._on_frames = on_frames
        loop = asyncio.get_running_loop()
        for node, sock in enumerate(self._groups):
            loop.add_reader(
                sock, self._on_readable, sock, node, partial(self._packet, PacketKind.GROUP), EVERYONE
            )
        for (at, other, port), sock in self._sockets.items():
            kind = PacketKind.UNICAST if port == self._plan.port else PacketKind.URGENT
            loop.add_reader(
                sock, self._on_readable, sock, at, partial(self._packet, kind), self._ethernet[other]
            )
        for (at, other), sock in self._listeners.items():
            loop.add_reader(sock, self._on_connection, sock, at, other)

    def _packet(self, kind: PacketKind, node: int, data: bytes) -> RelayPacket:
        return RelayPacket(kind, node, data)

    def _on_readable(
        self,
        sock: socket.socket,
        node: int,
        packet: Callable[[int, bytes], RelayPacket],
        address: bytes,
    ) -> None:
        own = self._plan.node(node)

        def frames() -> Iterator[bytes]:
            for _ in range(TURN):
                try:
                    data, source = sock.recvfrom(DATAGRAM_MAX)
                except BlockingIOError:
                    return
                except OSError as error:  # a node that is being started again has closed its port
                    log.debug("node %d: %s", node, error)
                    continue
                if source[0] == own:  # in its group the relay receives its own datagrams as well
                    yield packet(node, data).frame(address)

        self._on_frames(node, frames())

    def write(self, receiver: int, frame: bytes) -> bool:
        """Hands what a frame carries to a node; False when its port is closed."""
        packet = RelayPacket.of(frame)
        if packet.kind >= PacketKind.SEGMENT:
            connection = self._connections.get(packet.connection)
            if connection is not None:
                connection.on_packet(receiver, packet)
            return connection is not None
        plan = self._plan
        port = plan.urgent_port if packet.kind is PacketKind.URGENT else plan.port
        host = plan.group_of(receiver) if packet.kind is PacketKind.GROUP else plan.node(receiver)
        try:
            self._sockets[receiver, packet.sender, port].sendto(packet.payload, (host, port))
        except OSError:  # the radio logs it; a datagram to a full or closed port is lost
            return False
        return True

    def _on_connection(self, listener: socket.socket, opener: int, target: int) -> None:
        try:
            accepted, _ = listener.accept()
        except OSError as error:  # it has given up
            log.debug("connection of node %d: %s", opener, error)
            return
        accepted.setblocking(False)
        number = next(self._numbers)
        connection = RelayedConnection(
            number,
            (opener, target),
            connect=partial(self._connect, opener, target),
            send=self._send,
            on_end=lambda: self._connections.pop(number, None),
        )
        self._connections[number] = connection
        self._start(self._accept(connection, accepted))

    async def _accept(self, connection: RelayedConnection, accepted: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.opener, accepted)

    def _connect(self, opener: int, target: int, connection: RelayedConnection) -> None:
        self._start(self._reach(opener, target, connection))

    async def _reach(self, opener: int, target: int, connection: RelayedConnection) -> None:
        plan = self._plan
        try:
            await asyncio.get_running_loop().create_connection(
                lambda: connection.target,
                plan.node(target),
                plan.urgent_port,
                local_addr=(plan.seen(opener, target), 0),
            )
        except OSError as error:
            log.debug("connection to node %d: %s", target, error)
            connection.refuse()

    def _start(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work, name="relayed connection")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _send(self, receiver: int, packets: Sequence[RelayPacket]) -> None:
        """Gives packets of a connection to the radio, not before its present deliveries are done."""
        address = self._ethernet[receiver]
        frames = [packet.frame(address) for packet in packets]
        asyncio.get_running_loop().call_soon(self._on_frames, packets[0].sender, frames)

    def close(self) -> None:
        """Closes all sockets and connections."""
        for connection in list(self._connections.values()):
            connection.abort()
        self._closing.close()

    def _bound(self, host: str, port: int, *, group: bool = False) -> socket.socket:
        sock = self._closing.enter_context(
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        )
        # by the address of loopback: struct ip_mreqn, see ip(7)
        membership = struct.pack("@4s4si", socket.inet_aton(host), socket.inet_aton(_LOOPBACK), 0)
        try:
            if group:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind((host, port))
            if group:
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            else:
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, membership)
        except OSError as error:
            raise ConfigError(f"relay: {host}:{port}: {error.strerror}; expected a free port") from error
        return sock

    def _listening(self, host: str) -> socket.socket:
        sock = self._closing.enter_context(
            socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        )
        port = self._plan.urgent_port
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind((host, port))
            sock.listen(BACKLOG)
        except OSError as error:
            raise ConfigError(f"relay: {host}:{port}: {error.strerror}; expected a free port") from error
        return sock
