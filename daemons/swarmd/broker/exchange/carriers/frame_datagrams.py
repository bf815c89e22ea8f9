"""Sealed UDP datagrams to neighbours: small frames, without a thread of libzmq, and packets."""

import asyncio
import contextlib
import logging
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final, NamedTuple, Protocol

from swarmd.broker.config import MAIN, Config
from swarmd.broker.core.frames import frame_datagram
from swarmd.broker.core.frames.frame_datagram import DatagramPaths
from swarmd.broker.core.membership.datagram_limiter import DatagramLimiter, member_ids
from swarmd.broker.core.swarm.media.medium import MAIN_MEDIUM, Address, MediumProfile
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.swarm.neighbours.medium_table import MediumAddress, Use
from swarmd.broker.core.traffic import Counters
from swarmd.broker.exchange.link_events import DatagramEvents
from swarmd.broker.sockets import arrival_stamp
from swarmd.broker.sockets.arrival_stamp import ANCILLARY, Ancillary, ArrivalStamps
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.pair_seal import PairEnd, PairSeal
from swarmware.errors import ConfigError, WireError
from swarmware.model.clock import Clock
from swarmware.model.frame import Frame, encode
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.seal import Refusal
from swarmware.types.net import UNACCEPTED

TURN: Final = 64
"""Datagrams read before control returns to the event loop."""
BURST_NS: Final = 300_000
"""Datagrams that come closer than this are read until none waits. After a single one nothing waits, mostly:
to find that out takes a call of the kernel and an exception, a twentieth of the work for a message."""
DATAGRAM_MAX: Final = 2048
SEALS_MAX: Final = 4096


log = logging.getLogger("swarm.broker")


class _Held(NamedTuple):
    """A datagram that waits for the end of a batch."""

    peer: LinkPeer
    frame: Frame | None
    """The frame in it, or None for a packet of the reliable link, which repeats what is lost."""
    datagram: bytes
    use: Use


class NeighbourMedia(Protocol):
    """By which media neighbours are reached, where there are several."""

    def ways(self, hw: int, use: Use) -> Sequence[MediumAddress]:
        """The media to a neighbour for this use."""
        ...

    def send(self, way: MediumAddress, datagram: bytes, *, urgent: bool) -> bool:
        """Sends by a medium beside the main network; False when it did not take it."""
        ...

    def on_packet(self, hw: int, medium: MediumProfile) -> None:
        """A packet of a neighbour came by a medium."""
        ...


class FrameDatagrams:
    """The UDP socket for frames, and the seals of the pairs with neighbours."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        own: PairEnd,
        clock: Clock,
        counters: Counters,
        port: int,
        ways: NeighbourMedia | None,
        events: DatagramEvents,
    ) -> None:
        """`port`: wanted, as the connections have it; `ways`: media to neighbours, where there are several.

        Raises: ConfigError when no port can be bound.
        """
        self._ways = ways
        self._keys = keys
        self._own = own
        self._clock = clock
        self._counters = counters
        self._events = events
        self._seals: dict[int, tuple[LinkPeer, PairSeal]] = {}
        """By hardware id, with the neighbour that the seal is for."""
        self._read_ns = 0
        """When the last datagrams were read."""
        self._sequence = 0
        """Number of the last datagram, counted over all neighbours: no nonce of a pair is used twice."""
        self._urgent_paths = DatagramPaths()
        self._other_paths = DatagramPaths(frame_datagram.BURST)
        """Paths of frames that are not urgent: their receivers are slow more often, which looks like loss."""
        self._held: list[_Held] | None = None
        """Datagrams that wait for the end of `batch`, or None outside: they are sent at once."""
        self._limiter = DatagramLimiter(member_ids(keys.roster))
        self._loop = asyncio.get_running_loop()
        self._socket = _bound_socket(config, port)
        self.port: int = self._socket.getsockname()[1]
        arrival_stamp.enable(self._socket)
        self._loop.add_reader(self._socket.fileno(), self._on_readable)

    def on_roster(self) -> None:
        """The keys have another roster."""
        self._limiter.members = member_ids(self._keys.roster)

    # sending

    def prepare(self, peer: LinkPeer) -> None:
        """Derives the keys of the pair with a neighbour, before the first frame needs them."""
        if peer.frame_port:
            self._seal_of(peer)

    def send(self, peer: LinkPeer, frame: Frame, encoded: bytes | None) -> bool:
        """Sends the first transmission of a frame; False when it must take the connection. `encoded`: as
        another process encoded it."""
        if not peer.frame_port or self._sequence >= frame_datagram.SEQUENCE_MAX:
            return False
        # a firewall may pass beacons, but not these datagrams
        if not self._paths(frame).may_send(peer.hw, self._clock.now_ns()) and peer.host:
            return False
        data = frame_datagram.pack(frame, encoded)
        seal = None if data is None else self._seal_of(peer)
        if data is None or seal is None:
            return False
        datagram = self._sealed(seal, frame_datagram.FRAME, data)
        if self._held is not None:
            self._held.append(_Held(peer, frame, datagram, Use.URGENT))
            return True
        if not self._put(peer, datagram, Use.URGENT):
            return False
        self._count(peer, frame)
        return True

    def send_unrepeated(self, peer: LinkPeer, frame: Frame) -> bool:
        """Sends a frame that is never repeated; returns False if it is too large, or the neighbour takes no
        datagrams."""
        data = encode(frame)
        is_possible = peer.frame_port and self._sequence < frame_datagram.SEQUENCE_MAX
        seal = self._seal_of(peer) if is_possible and len(data) <= frame_datagram.FRAME_MAX else None
        if seal is None:
            return False
        if not self._put(peer, self._sealed(seal, frame_datagram.FRAME, data), Use.PACKETS):
            return False
        self._events.on_begun(peer, frame)
        return True

    def send_packet(self, peer: LinkPeer, data: bytes) -> None:
        """Sends a packet of the reliable link; a packet that cannot be sent counts as lost on the way."""
        seal = self._seal_of(peer) if self._sequence < frame_datagram.SEQUENCE_MAX else None
        if seal is None or not peer.frame_port:
            return
        datagram = self._sealed(seal, frame_datagram.PACKET, data)
        if self._held is not None:
            self._held.append(_Held(peer, None, datagram, Use.PACKETS))
        else:
            self._put(peer, datagram, Use.PACKETS)

    def _sealed(self, seal: PairSeal, content: int, data: bytes) -> bytes:
        self._sequence += 1
        clear = frame_datagram.encode_header(content, self._own.hw, self._sequence)
        return clear + seal.seal(self._sequence, clear, data)

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Context manager: queues datagrams, packets included, and sends them together when it ends.

        Each datagram wakes its receiver: on a computer with several nodes the first receiver would take the
        processor before the last datagram is sent. Measured with 16 nodes on two cores: 15 ms between first
        and last.
        """
        if self._held is not None:
            yield  # the outer scope sends them
            return
        self._held = []
        try:
            yield
        finally:
            held, self._held = self._held, None
            # all are sent before the first is counted; accounting would delay the last one
            sent = [self._put(one.peer, one.datagram, one.use) for one in held]
            for one, is_sent in zip(held, sent, strict=True):
                if one.frame is None:
                    continue
                if is_sent:
                    self._count(one.peer, one.frame)
                else:
                    self._events.on_unsent(one.peer, one.frame)

    def _count(self, peer: LinkPeer, frame: Frame) -> None:
        self._paths(frame).on_sent(peer.hw, self._clock.now_ns())
        self._events.on_begun(peer, frame)

    def on_repeated(self, hw: int, frame: Frame) -> None:
        """A frame is repeated to a neighbour, over the connection."""
        self._paths(frame).on_repeated(hw, self._clock.now_ns())

    def _paths(self, frame: Frame) -> DatagramPaths:
        return self._urgent_paths if frame.is_urgent else self._other_paths

    def _put(self, peer: LinkPeer, datagram: bytes, use: Use) -> bool:
        """Sends a datagram by the media for this use; False when none took it."""
        if self._ways is None:
            return self._put_main(peer, peer.host, datagram)
        taken = False
        for way in self._ways.ways(peer.hw, use):
            if way.medium.name == MAIN:
                taken |= self._put_main(peer, way.address[0], datagram)
            elif self._ways.send(way, datagram, urgent=use is Use.URGENT):
                size = way.medium.counted_bytes(len(datagram))
                self._counters.datagram_sent(size, peer.platform, way.medium.transport)
                taken = True
        return taken

    def _put_main(self, peer: LinkPeer, host: str, datagram: bytes) -> bool:
        try:
            self._socket.sendto(datagram, (host, peer.frame_port))
        except OSError as error:
            log.debug("frame for %s as datagram: %s", peer.platform, error)
            return False
        self._counters.datagram_sent(len(datagram), peer.platform)
        return True

    def _seal_of(self, peer: LinkPeer) -> PairSeal | None:
        known = self._seals.get(peer.hw)
        if known is not None and known[0] is peer:
            return known[1]
        if not peer.session:
            return None
        other = PairEnd(peer.hw, peer.session, peer.curve_public)
        # the keys belong to the pair of sessions; deriving them again would reset the replay window
        if known is not None and known[1].other == other:
            seal = known[1]  # the neighbour has another address or port
        else:
            try:
                seal = PairSeal(self._keys.curve_secret, self._own, other)
            except ValueError as error:
                log.debug("key of %s: %s", peer.platform, error)
                return None
        self._seals.pop(peer.hw, None)
        # the first entry is the pair whose endpoint changed the longest time ago
        if len(self._seals) >= SEALS_MAX:
            del self._seals[next(iter(self._seals))]
        self._seals[peer.hw] = peer, seal
        return seal

    # receiving

    def _on_readable(self) -> None:
        now_ns = self._clock.now_ns()
        # see BURST_NS; in a burst more datagrams wait, after a pause mostly none
        turn = TURN if now_ns - self._read_ns < BURST_NS else 1
        self._read_ns = now_ns
        for _ in range(turn):
            try:
                data, ancillary, _, address = self._socket.recvmsg(DATAGRAM_MAX, ANCILLARY)
            except BlockingIOError:
                return
            except OSError as error:
                log.debug("receiving frames as datagrams: %s", error)
                return
            self._take(MAIN_MEDIUM, data, address, ancillary)

    def on_arrival(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        """Takes a datagram that came by a medium beside the main network."""
        self._take(medium, arrival.data, arrival.address, arrival.rx_mono_ns)

    def _take(self, medium: MediumProfile, data: bytes, address: Address, arrival: int | Ancillary) -> None:
        """`arrival`: on CLOCK_MONOTONIC, or the kernel's stamp, which only packets need."""
        size = medium.counted_bytes(len(data))
        counters, limiter = self._counters, self._limiter
        try:
            content, sender_hw, sequence = frame_datagram.decode_header(data)
        except WireError as error:
            limiter.bad(address)
            counters.datagram_received(size, UNACCEPTED, medium.transport)
            counters.refused.malformed += 1
            log.debug("datagram from %s:%d: %s", *address, error)
            return
        if self._events.excludes(sender_hw):
            counters.refused.revoked += 1
            return
        # before the cryptography, which a flood would make this node compute
        if not limiter.may_open(address, sender_hw, self._clock.now_ns()):
            counters.refused.flooded += 1
            return
        peer = self._events.find_peer(sender_hw)
        seal = None if peer is None else self._seal_of(peer)
        if peer is None or seal is None:
            limiter.bad(address)
            counters.datagram_received(size, UNACCEPTED, medium.transport)
            counters.refused.unknown_session += 1
            return
        start = frame_datagram.HEADER_BYTES
        opened = seal.open(sequence, data[:start], data[start:])
        link = counters.datagram_received(size, peer.platform, medium.transport)
        if isinstance(opened, Refusal):
            if opened is Refusal.REPLAYED:
                counters.refused.replayed += self._ways is None  # with several media it is a copy
                link.duplicates += 1
            else:
                limiter.bad(address)
                counters.refused.forged += 1
            return
        limiter.good(address)
        if content == frame_datagram.PACKET and self._ways is not None:
            self._ways.on_packet(sender_hw, medium)
        if content == frame_datagram.FRAME:
            self._events.on_datagram_frame(opened.body, peer)
        else:
            mono_ns = arrival if isinstance(arrival, int) else ArrivalStamps().mono_ns(arrival)
            self._events.on_packet(opened.body, peer, self._clock.from_mono_ns(mono_ns))

    def close(self) -> None:
        """Closes the socket for frames."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()


def _bound_socket(config: Config, port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    with contextlib.suppress(OSError):  # the number is in use: another one below
        sock.bind((config.bind_address, port))
        return sock
    try:
        sock.bind((config.bind_address, 0))  # the number is in use; neighbours learn the port from the hello
    except OSError as error:
        sock.close()
        raise ConfigError(f"broker: bind_address {config.bind_address}: {error.strerror}") from error
    return sock
