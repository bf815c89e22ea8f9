"""Frames that must arrive: ZeroMQ over TCP with CURVE, one socket in, two to each neighbour out."""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import msgspec
import zmq

from swarmd.broker.config import Config
from swarmd.broker.core.queue import Lane, Queue, Waiting, lane
from swarmd.broker.links.port import Monitor, Port, Socket
from swarmd.broker.links.tcp_count import TcpCount
from swarmd.broker.links.zap import DOMAIN, Zap
from swarmware.errors import ConfigError
from swarmware.frame import HEADER_BYTES, PAYLOAD_LIMIT, Frame
from swarmware.post.port import make_context
from swarmware.security import Keys

SEND_HIGH_WATER: Final = 4
"""Frames inside libzmq per connection; the rest waits in a queue of ours that knows priorities."""
SEND_BUFFER_BYTES: Final = 32 * 1024
"""Of a connection, in the kernel, which doubles it for its own needs. Without it Linux takes up to 4 MB."""
RECEIVE_HIGH_WATER: Final = 64
SOCKETS_MAX: Final = 4096
"""In libzmq: six for each neighbour, a connection and both ends of its monitor, twice."""
RECONNECT_MS: Final = 50
RECONNECT_MAX_MS: Final = 200
CONNECT_TIMEOUT_MS: Final = 300
HANDSHAKE_MS: Final = 3000
FAILURES: Final = 3
"""Handshakes in a row that break off without a reason; a wrong key looks like that."""
DENIED_NS: Final = 2_000_000_000
"""Pause before a neighbour that denied us is tried again."""
KEEPALIVE_S: Final = 60
"""A connection whose other end vanished without a word is taken away after 90 s."""
_EXTENSION_MAX: Final = 255

OnFrame = Callable[[bytes, str], None]
"""Takes an encoded frame and the platform at the other end; empty where nobody can tell."""

log = logging.getLogger("swarm.broker")


class Peer(msgspec.Struct, frozen=True):
    """Where a neighbour takes frames."""

    hw: int
    platform: str
    host: str
    port: int
    curve_public: bytes
    session: int


class _Connection:
    """One connection to a neighbour; takes the frames of its lane out of the queue."""

    def __init__(self, way: "_Way", lane: Lane) -> None:
        self.connected = False
        self._way = way
        self._links = links = way.links
        self._lane = lane
        self._failures = 0
        peer = way.peer
        socket = links.make_socket(zmq.DEALER)
        socket.setsockopt(zmq.SNDHWM, SEND_HIGH_WATER)
        socket.setsockopt(zmq.SNDBUF, SEND_BUFFER_BYTES)
        socket.setsockopt(zmq.CURVE_SERVERKEY, peer.curve_public)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, links.keys.curve_public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, links.keys.curve_secret)
        socket.setsockopt(zmq.CONNECT_TIMEOUT, CONNECT_TIMEOUT_MS)
        socket.setsockopt(zmq.RECONNECT_IVL, RECONNECT_MS)
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, RECONNECT_MAX_MS)
        socket.setsockopt(zmq.IMMEDIATE, 1)
        self._monitor = Monitor(socket, links.loop, self._on_event)
        socket.connect(f"tcp://{peer.host}:{peer.port}")
        self._port = Port(socket, links.loop, self._on_wake, self._wants)

    def flush(self, now_ns: int) -> None:
        if self._port.is_closed():
            return
        queue, lane, send = self._way.queue, self._lane, self._port.socket.send
        sent = False
        while True:
            waiting, old = queue.peek(lane, now_ns)
            if old:
                self._links.gave_up(self._way.peer, old)
                continue  # its answers to senders may have gone into this queue
            if waiting is None:
                break
            try:
                send(waiting.data, zmq.NOBLOCK)
            except zmq.Again:
                break
            queue.pop(lane)
            self._links.sent_one(self._way.peer, waiting)
            sent = True
        if sent:
            self._port.again()  # a send takes commands from the mailbox and may eat the wake-up

    def _on_wake(self, socket: Socket) -> bool:
        if self._way.queue.has(self._lane):
            self.flush(self._links.now_ns())
        return False

    def _wants(self) -> int:
        return zmq.POLLOUT if self._way.queue.has(self._lane) else 0

    def _on_event(self, event: int, value: int) -> None:
        if self._way.denied:
            return  # what comes now is the end of the attempt that failed
        if event == zmq.EVENT_CONNECTED:
            self._links.count.add(value)
        elif event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self.connected = True
            self._failures = 0
            self.flush(self._links.now_ns())
        elif event == zmq.EVENT_DISCONNECTED:
            self.connected = False
        elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._way.deny("it denies us")
        elif event == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
            self._failures += 1
            if self._failures >= FAILURES:
                self._way.deny("it has another key than the roster says")

    def shut(self) -> None:
        self._monitor.close()
        self._port.close()


class _Way:
    """The connections to one neighbour, with what waits for them."""

    def __init__(self, links: "Links", peer: Peer) -> None:
        self.links = links
        self.peer = peer
        self.queue = Queue()
        self.denied = False
        self.denied_until_ns = 0
        # at once, so that no urgent frame waits for a handshake; the other one with its first frame
        self._connections = {Lane.CONTROL: _Connection(self, Lane.CONTROL)}

    @property
    def state(self) -> str:
        if self.denied:
            return "denied"
        return "connected" if all(one.connected for one in self._connections.values()) else "connecting"

    def put(self, data: bytes, frame: Frame, now_ns: int) -> list[Waiting]:
        gone = self.queue.put(data, frame, now_ns)
        if lane(frame) not in self._connections:
            self._connections[lane(frame)] = _Connection(self, lane(frame))
        if not self.links.holds(self):
            self.flush(now_ns)
        return gone

    def flush(self, now_ns: int) -> None:
        for connection in tuple(self._connections.values()):
            connection.flush(now_ns)

    def deny(self, reason: str) -> None:
        log.warning("no frames go to %s: %s", self.peer.platform, reason)
        self.denied = True
        self.denied_until_ns = self.links.now_ns() + DENIED_NS
        self.links.gave_up(self.peer, self.queue.clear())
        # libzmq would try again five times a second, for ever
        self.links.loop.call_soon(self._shut)

    def _shut(self) -> None:
        for connection in self._connections.values():
            connection.shut()

    def close(self) -> list[Waiting]:
        self.links.count.sample_all()
        self._shut()
        return self.queue.clear()


class Links:
    """All ZeroMQ connections of the broker."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        loop: asyncio.AbstractEventLoop,
        *,
        now_ns: Callable[[], int],
        on_frame: OnFrame,
        on_given_up: Callable[[Peer, list[Waiting]], None],
        on_sent: Callable[[Peer, Waiting], None],
    ) -> None:
        """Raises: ConfigError when the port cannot be bound."""
        self.loop = loop
        self.keys = keys
        self.now_ns = now_ns
        self.count = TcpCount()
        self.received_frames = 0
        self.received_bytes = 0
        self.broken_handshakes = 0
        """Connections to us that never got as far as showing a key."""
        self.gave_up = on_given_up
        self.sent_one = on_sent
        self._heartbeat_ms = round(config.heartbeat_s * 1000)
        self._on_frame = on_frame
        self._ways: dict[int, _Way] = {}
        self._held: dict[_Way, None] | None = None
        """Ways with frames that wait for the end of `together`; None: frames are sent at once."""
        self._context = make_context(SOCKETS_MAX)
        # before the first socket with CURVE: without an answering authenticator libzmq would let all in
        self._zap = Zap(self._context, loop, keys)
        router = self.make_socket(zmq.ROUTER)
        router.setsockopt(zmq.CURVE_SERVER, 1)
        router.setsockopt(zmq.CURVE_SECRETKEY, keys.curve_secret)
        router.setsockopt_string(zmq.ZAP_DOMAIN, DOMAIN)
        router.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        router.setsockopt(zmq.TCP_KEEPALIVE, 1)
        router.setsockopt(zmq.TCP_KEEPALIVE_IDLE, KEEPALIVE_S)
        router.setsockopt(zmq.TCP_KEEPALIVE_INTVL, 10)
        router.setsockopt(zmq.TCP_KEEPALIVE_CNT, 3)
        self._monitor = Monitor(router, loop, self._on_router_event)
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
        self.port = int(router.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
        self._router = Port(router, loop, self._take)

    @property
    def denied(self) -> int:
        """Connections of strangers: with a wrong key, or one too many without any."""
        return self._zap.denied + self.count.shut

    def make_socket(self, kind: int) -> Socket:
        """A socket that neither waits nor hoards."""
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RCVHWM, RECEIVE_HIGH_WATER)
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        socket.setsockopt(zmq.MAXMSGSIZE, PAYLOAD_LIMIT + HEADER_BYTES + _EXTENSION_MAX)
        if self._heartbeat_ms:
            socket.setsockopt(zmq.HEARTBEAT_IVL, self._heartbeat_ms)
            socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3 * self._heartbeat_ms)
        return socket

    # out

    @contextmanager
    def together(self) -> Iterator[None]:
        """Frames that are sent meanwhile are handed to libzmq at its end, one right behind the other.

        Otherwise its thread sends the first while others are still being made, and on a busy computer the
        receivers that this wakes take its turns until the last has waited for all of them.
        """
        if self._held is not None:
            yield  # the outer one sends them
            return
        self._held = {}
        try:
            yield
        finally:
            held, self._held = self._held, None
            now_ns = self.now_ns()
            for way in held:
                way.flush(now_ns)

    def holds(self, way: _Way) -> bool:
        """Whether the frames of this way are sent later; then they will be."""
        if self._held is None:
            return False
        self._held[way] = None
        return True

    def send(self, peer: Peer, data: bytes, frame: Frame) -> list[Waiting]:
        """Sends a frame to a neighbour, or queues it; what had to be dropped for it."""
        way = self._ways.get(peer.hw)
        gone: list[Waiting] = []
        if way is not None and way.denied:
            if self.now_ns() < way.denied_until_ns:
                return [Waiting(data, frame, self.now_ns())]
            self._ways.pop(peer.hw).close()
            way = None
        if way is None or way.peer != peer:
            waiting = way.close() if way is not None else []
            way = self._ways[peer.hw] = _Way(self, peer)
            for item in waiting:
                gone += way.put(item.data, item.frame, item.since_ns)
        return gone + way.put(data, frame, self.now_ns())

    def drop(self, hw: int) -> list[Waiting]:
        """Closes the connections to a neighbour that is gone; what still waited for it.

        A connection that stayed open through an outage would wait for TCP's back-off after it (RFC 6298,
        section 5.5), about half of the outage's length; a new one is there within milliseconds (ADR 9).
        """
        way = self._ways.pop(hw, None)
        return way.close() if way is not None else []

    def state(self, hw: int) -> str:
        """How frames go to a neighbour."""
        way = self._ways.get(hw)
        return "idle" if way is None else "tcp" if way.state == "connected" else f"tcp {way.state}"

    # in

    def _take(self, socket: Socket) -> bool:
        try:
            parts = socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return False
        if len(parts) == 2:
            data = parts[1].bytes
            self.received_frames += 1
            self.received_bytes += len(data)
            self._on_frame(data, str(parts[1].get("User-Id")))
        return True

    def _on_router_event(self, event: int, value: int) -> None:
        if event == zmq.EVENT_ACCEPTED:
            self.count.accept(value)
        elif event in (zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL, zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL):
            self.broken_handshakes += 1

    def close(self) -> None:
        """Closes everything."""
        for hw in list(self._ways):
            self.drop(hw)
        self._monitor.close()
        self._router.close()
        self._zap.close()
        self._context.destroy(linger=0)
