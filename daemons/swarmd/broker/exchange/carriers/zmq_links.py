"""Reliable transport of frames: ZeroMQ over TCP with CURVE; one ROUTER, two DEALERs to each neighbour."""

import asyncio
import logging
import random
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final

import zmq

from swarmd.broker.config import EVERYWHERE, Config
from swarmd.broker.core.frames.send_buffer import SIZE_MIN
from swarmd.broker.core.frames.send_queue import ConnectionClass, QueuedFrame, SendQueue, connection_class
from swarmd.broker.core.swarm.links.link import ConnectionDelay
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.exchange.link_events import ConnectionEvents
from swarmd.broker.sockets.zmq.tcp_count import TcpCount
from swarmd.broker.sockets.zmq.tcp_socket import TcpSocket
from swarmd.broker.sockets.zmq.zap import DOMAIN, Zap
from swarmd.broker.sockets.zmq.zmq_socket import POLLOUT, ConnectionMonitor, Socket, ZmqSocket, make_context
from swarmware.errors import ConfigError
from swarmware.model.frame import FRAME_LIMIT, KIND_AT, Frame, FrameKind
from swarmware.transport.security.keys import Keys
from swarmware.types.net import ConnectionStatus
from swarmware.types.traffic import Refused

SEND_HIGH_WATER: Final = 4
"""Frames inside libzmq per connection; the rest waits in the send queue, which has priorities."""
RECEIVE_HIGH_WATER: Final = 64
SOCKETS_MAX: Final = 4096
"""Limit of libzmq: six for each neighbour, a connection and both ends of its monitor, twice."""
RECONNECT_MS: Final = 50
RECONNECT_MAX_MS: Final = 200
CONNECT_TIMEOUT_MS: Final = 300
HANDSHAKE_MS: Final = 3000
FAILURES: Final = 3
"""Consecutive handshakes that fail without a reason, after which the server key is assumed to differ."""
DENIED_NS: Final = 2_000_000_000
"""Pause before the next connection to a neighbour that denied the last one."""
REBIND_S: Final = (0.1, 0.8)
"""Time after which the connections of a revoked member end."""
BIND_AGAIN_S: Final = 0.005
KEEPALIVE_S: Final = 60
"""Idle time before TCP keep-alive probes; a dead connection is closed after 90 s."""

log = logging.getLogger("swarm.broker")


class _Connection:
    """One connection to a neighbour; sends the frames of its class from the queue."""

    def __init__(self, connections: "_PeerConnections", connection_class: ConnectionClass) -> None:
        self.connected = False
        self._owner = connections
        self._links = links = connections.links
        self._class = connection_class
        self._tcp: TcpSocket | None = None
        self._failures = 0
        peer = connections.peer
        socket = links.make_socket(zmq.DEALER)
        socket.setsockopt(zmq.SNDHWM, SEND_HIGH_WATER)
        socket.setsockopt(zmq.SNDBUF, connections.buffer_bytes)
        socket.setsockopt(zmq.CURVE_SERVERKEY, peer.curve_public)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, links.keys.curve_public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, links.keys.curve_secret)
        socket.setsockopt(zmq.CONNECT_TIMEOUT, CONNECT_TIMEOUT_MS)
        socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, RECONNECT_MAX_MS)
        # without it libzmq queues frames for a connection that is not open, where priorities do not reach
        socket.setsockopt(zmq.IMMEDIATE, 1)
        self._monitor = ConnectionMonitor(socket, links.loop, self._on_event)
        socket.connect(f"tcp://{peer.host}:{peer.port}")
        self._port = ZmqSocket(socket, links.loop, self._on_wake, self._wants)

    def send_at_once(self, data: bytes, frame: Frame) -> bool:
        """Send a frame before which none is queued; False when libzmq has no room for it."""
        if not self.connected or self._port.is_closed:
            return False
        try:
            self._port.socket.send(data, zmq.NOBLOCK)
        except zmq.Again:
            return False
        self._links.events.on_taken(self._owner.peer, len(data), frame)
        return True

    def flush(self, now_ns: int) -> None:
        if self._port.is_closed:
            return
        queue, connection_class, send = self._owner.queue, self._class, self._port.socket.send
        sent = False
        while True:
            waiting, old = queue.peek(connection_class, now_ns)
            if old:
                self._links.events.on_undelivered(self._owner.peer, old)
                continue  # refusals to their senders may have been queued here
            if waiting is None:
                break
            try:
                send(waiting.data, zmq.NOBLOCK)
            except zmq.Again:
                break
            queue.pop(connection_class)
            self._links.events.on_taken(self._owner.peer, len(waiting.data), waiting.frame)
            sent = True
        if sent and queue:
            self._port.again()  # a send processes commands: the descriptor may be silent about new room

    def _on_wake(self, socket: Socket) -> None:
        if self._owner.queue.has(self._class):
            self.flush(self._links.now_ns())

    def _wants(self) -> int:
        return POLLOUT if self._owner.queue.has(self._class) else 0

    def _on_event(self, event: int, value: int) -> None:
        if self._owner.denied:
            return  # events of the attempt that failed
        if event == zmq.EVENT_CONNECTED:
            self._links.count.add(value)
            self._tcp = TcpSocket(value)
        elif event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self.connected = True
            self._failures = 0
            self.flush(self._links.now_ns())
        elif event == zmq.EVENT_DISCONNECTED:
            self.connected = False
        elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._owner.deny("it denied the connection")
        elif event == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
            self._failures += 1
            # libzmq gives no reason; a different server key looks like an interrupted handshake
            if self._failures >= FAILURES:
                self._owner.deny("its key differs from the roster")

    def delay(self) -> ConnectionDelay | None:
        """Round trips of this connection, or None until it is connected and measured."""
        return self._tcp.delay() if self.connected and self._tcp is not None else None

    def limit(self, send_bytes: int) -> None:
        if self._tcp is not None:
            self._tcp.limit(send_bytes)

    def shut(self) -> None:
        self._monitor.close()
        self._port.close()


class _PeerConnections:
    """The connections to one neighbour and the queue of frames for them."""

    def __init__(self, links: "ZmqLinks", peer: LinkPeer) -> None:
        self.links = links
        self.peer = peer
        self.queue = SendQueue()
        self.buffer_bytes = SIZE_MIN
        self.denied = False
        self.denied_until_ns = 0
        # opened at once, so that no urgent frame waits for a handshake; the data connection opens on demand
        self._connections = {ConnectionClass.CONTROL: _Connection(self, ConnectionClass.CONTROL)}

    @property
    def status(self) -> ConnectionStatus:
        if self.denied:
            return ConnectionStatus.DENIED
        connected = all(one.connected for one in self._connections.values())
        return ConnectionStatus.CONNECTED if connected else ConnectionStatus.CONNECTING

    def put(self, queued: QueuedFrame) -> list[QueuedFrame]:
        data, frame = queued.data, queued.frame
        wanted = connection_class(frame)
        connection = self._connections.get(wanted)
        if connection is None:
            connection = self._connections[wanted] = _Connection(self, wanted)
        deferred = self.links.deferred
        # the common case; nothing waits, and no queue is touched
        if deferred is None and not self.queue and connection.send_at_once(data, frame):
            return []
        gone = self.queue.put(data, frame, queued.since_ns)
        if deferred is None:
            self.flush(self.links.now_ns())
        else:
            deferred[self] = None
        return gone

    def flush(self, now_ns: int) -> None:
        for connection in tuple(self._connections.values()):
            connection.flush(now_ns)
        if self.queue:
            self.links.events.on_waiting(self.peer)

    def delay(self) -> ConnectionDelay | None:
        """Round trips of the connection with the longer queue."""
        found = [one.delay() for one in self._connections.values()]
        return max((one for one in found if one is not None), key=_excess_ns, default=None)

    def limit(self, send_bytes: int) -> None:
        self.buffer_bytes = send_bytes
        for connection in self._connections.values():
            connection.limit(send_bytes)

    def deny(self, reason: str) -> None:
        log.warning("no frames go to %s: %s", self.peer.platform, reason)
        self.denied = True
        self.denied_until_ns = self.links.now_ns() + DENIED_NS
        self.links.events.on_undelivered(self.peer, self.queue.clear())
        # libzmq would reconnect five times a second without end
        self.links.loop.call_soon(self._shut)

    def _shut(self) -> None:
        for connection in self._connections.values():
            connection.shut()

    def close(self) -> list[QueuedFrame]:
        self.links.count.sample_all()
        self._shut()
        return self.queue.clear()


class ZmqLinks:
    """All ZeroMQ connections of the broker, by neighbour."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        loop: asyncio.AbstractEventLoop,
        *,
        now_ns: Callable[[], int],
        refused: Refused,
        events: ConnectionEvents,
    ) -> None:
        """Raises: ConfigError when the port cannot be bound."""
        self.loop = loop
        self.keys = keys
        self.now_ns = now_ns
        self.count = TcpCount()
        self.received_frames = 0
        self.received_bytes = 0
        self._accepted = 0
        self._proven = 0
        self._denied = 0
        self.events = events
        self._heartbeat_ms = round(config.heartbeat_s * 1000)
        self._refused = refused
        self._rebinding: asyncio.TimerHandle | None = None
        self._peers: dict[int, _PeerConnections] = {}
        self.deferred: dict[_PeerConnections, None] | None = None
        """Connections with frames that wait for the end of `batch`, or None outside of it."""
        self._context = make_context(SOCKETS_MAX)
        # before the first CURVE socket: without an authenticator libzmq accepts every client
        self._zap = Zap(self._context, loop, keys, refused, events.on_unknown_key)
        router = self.make_socket(zmq.ROUTER)
        router.setsockopt(zmq.CURVE_SERVER, 1)
        router.setsockopt(zmq.CURVE_SECRETKEY, keys.curve_secret)
        router.setsockopt_string(zmq.ZAP_DOMAIN, DOMAIN)
        router.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        router.setsockopt(zmq.TCP_KEEPALIVE, 1)
        router.setsockopt(zmq.TCP_KEEPALIVE_IDLE, KEEPALIVE_S)
        router.setsockopt(zmq.TCP_KEEPALIVE_INTVL, 10)
        router.setsockopt(zmq.TCP_KEEPALIVE_CNT, 3)
        self._monitor = ConnectionMonitor(router, loop, self._on_router_event)
        where = f"tcp://{config.bind_address}:{config.tcp_port or '*'}"
        try:
            router.bind(where)
        except zmq.ZMQError as error:
            self._monitor.close()
            router.close(linger=0)
            self._zap.close()
            self._context.destroy(linger=0)
            raise ConfigError(
                f"broker: bind_address {config.bind_address}, tcp_port {config.tcp_port}: {error.strerror}"
            ) from error
        self._endpoints = [router.getsockopt_string(zmq.LAST_ENDPOINT)]
        """Where connections are taken."""
        self.port = int(self._endpoints[0].rpartition(":")[2])
        self._bind_networks(router, config)
        self._router = ZmqSocket(router, loop, self._take)

    def _bind_networks(self, router: Socket, config: Config) -> None:
        """Takes connections on the further networks, too, unless the address of the first one covers all."""
        if config.bind_address == EVERYWHERE:
            return
        for network in config.network:
            if network.interface == config.bind_address:
                continue
            try:
                router.bind(f"tcp://{network.interface}:{self.port}")
            except zmq.ZMQError as error:
                log.warning(
                    "network %s: no connections on %s:%d: %s",
                    network.name,
                    network.interface,
                    self.port,
                    error.strerror,
                )
            else:
                self._endpoints.append(router.getsockopt_string(zmq.LAST_ENDPOINT))

    @property
    def denied(self) -> int:
        """Incoming connections that ended before they proved a key of the roster."""
        self._denied = max(self._denied, self._accepted - self._proven - self.count.half_open())
        return self._denied

    def make_socket(self, kind: int) -> Socket:
        """Creates a socket with bounded queues, message size and handshake time."""
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RCVHWM, RECEIVE_HIGH_WATER)
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        socket.setsockopt(zmq.MAXMSGSIZE, FRAME_LIMIT)
        if self._heartbeat_ms:
            socket.setsockopt(zmq.HEARTBEAT_IVL, self._heartbeat_ms)
            socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3 * self._heartbeat_ms)
        return socket

    # out

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Defers frames sent in its scope and passes them to libzmq together at its end.

        Otherwise the thread of libzmq sends the first frame while later ones are still being encoded; on a
        busy computer the receivers that it wakes take the processor, and the last frame waits for all of
        them.
        """
        if self.deferred is not None:
            yield  # the outer scope sends them
            return
        self.deferred = {}
        try:
            yield
        finally:
            deferred, self.deferred = self.deferred, None
            now_ns = self.now_ns()
            for connections in deferred:
                connections.flush(now_ns)

    def send(self, peer: LinkPeer, queued: QueuedFrame) -> list[QueuedFrame]:
        """Sends or queues a frame for a neighbour; returns the frames that were dropped from the queue."""
        connections = self._peers.get(peer.hw)
        # the endpoint is the same object until something in it changes
        if connections is not None and connections.peer is peer and not connections.denied:
            return connections.put(queued)
        gone: list[QueuedFrame] = []
        if connections is not None and connections.denied:
            # the handshake would fail again; the frame is refused to its sender at once
            if self.now_ns() < connections.denied_until_ns:
                return [queued]
            self._peers.pop(peer.hw).close()
            connections = None
        if connections is None or connections.peer != peer:
            waiting = connections.close() if connections is not None else []
            connections = self._peers[peer.hw] = _PeerConnections(self, peer)
            # the neighbour has another address or session; its frames follow it
            for item in waiting:
                gone += connections.put(item)
        return gone + connections.put(queued)

    def disconnect(self, hw: int) -> list[QueuedFrame]:
        """Closes the connections to a lost neighbour; returns the frames that were queued for it.

        A connection that stayed open through an outage would wait for TCP's back-off after it (RFC 6298,
        section 5.5), about half of the outage's length; a new one takes milliseconds (ADR 49).
        """
        connections = self._peers.pop(hw, None)
        return connections.close() if connections is not None else []

    def take_queue(self, hw: int) -> list[QueuedFrame]:
        """Removes and returns the frames that wait for the connections to a neighbour, which stay open."""
        connections = self._peers.get(hw)
        return [] if connections is None else connections.queue.clear()

    def peers(self) -> list[LinkPeer]:
        """The neighbours with connections."""
        return [connections.peer for connections in self._peers.values()]

    def waiting(self, hw: int) -> tuple[int, int]:
        """Frames that wait for the connections to a neighbour, and their bytes."""
        connections = self._peers.get(hw)
        return (0, 0) if connections is None else (len(connections.queue), connections.queue.queued_bytes)

    def delay(self, hw: int) -> ConnectionDelay | None:
        """Round trips of the connections to a neighbour, or None if the kernel has measured none."""
        connections = self._peers.get(hw)
        return None if connections is None else connections.delay()

    def limit(self, hw: int, send_bytes: int) -> None:
        """Sets the send buffer of the connections to a neighbour, which Linux doubles."""
        connections = self._peers.get(hw)
        if connections is not None:
            connections.limit(send_bytes)

    def state(self, hw: int) -> ConnectionStatus:
        """State of the connections to a neighbour."""
        connections = self._peers.get(hw)
        return ConnectionStatus.IDLE if connections is None else connections.status

    # in

    def _take(self, socket: Socket) -> None:
        try:
            socket.recv(zmq.NOBLOCK)  # the routing id
        except zmq.Again:
            return
        part = socket.recv(zmq.NOBLOCK, copy=False)
        if part.more:
            socket.recv_multipart(zmq.NOBLOCK)  # a frame is one part
            return
        data = part.bytes
        user = str(part.get("User-Id"))
        if user:  # the connection was accepted with a former roster
            member = self.keys.by_user(user)
            if member is None:
                self._refused.revoked += 1
                return
            user = member.platform
        self.received_frames += 1
        self.received_bytes += len(data)
        if len(data) > KIND_AT and data[KIND_AT] == FrameKind.ROSTER:
            self.events.on_roster_frame(data, user, str(part.get("Peer-Address")))
        else:
            self.events.on_connection_frame(data, user)

    def drop_revoked(self) -> None:
        """Ends the connections of revoked members: the port is released and taken again, others reconnect.

        Their frames are refused before that; at different instants, as all neighbours of the member do this.
        """
        if self._rebinding is None and any(self.keys.by_user(user) is None for user in self._zap.users):
            self._rebinding = self.loop.call_later(random.uniform(*REBIND_S), self._unbind)

    def _unbind(self) -> None:
        for where in self._endpoints:
            self._router.socket.unbind(where)
        self._zap.users.clear()
        self._bind(self._endpoints)

    def _bind(self, endpoints: Iterable[str]) -> None:
        self._rebinding, left = None, list[str]()
        for where in endpoints:
            try:
                self._router.socket.bind(where)
            except zmq.ZMQError as error:  # the thread of libzmq has not released the port yet
                log.debug("%s: %s", where, error.strerror)
                left.append(where)
        # the port is free after the thread of libzmq has closed its socket
        if left:
            self._rebinding = self.loop.call_later(BIND_AGAIN_S, lambda: self._bind(left))

    def _on_router_event(self, event: int, value: int) -> None:
        if event == zmq.EVENT_ACCEPTED:
            self._accepted += 1
            self.count.accept(value)
        elif event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._proven += 1

    def close(self) -> None:
        """Closes all sockets and the context."""
        for hw in list(self._peers):
            self.disconnect(hw)
        if self._rebinding is not None:
            self._rebinding.cancel()
        self._monitor.close()
        self._router.close()
        self._zap.close()
        self._context.destroy(linger=0)


def _excess_ns(delay: ConnectionDelay) -> int:
    return delay.excess_ns
