"""UDP sockets for multicast and unicast datagrams, with the kernel's receive timestamps."""

import asyncio
import contextlib
import logging
import socket
import struct
from typing import Final

import msgspec

from swarmd.broker.config import EVERYWHERE, MAIN, Config, NetworkMedium
from swarmd.broker.core.swarm.media.medium import MAIN_MEDIUM, Address, MediumProfile, network_medium
from swarmd.broker.sockets import arrival_stamp
from swarmd.broker.sockets.arrival_stamp import ANCILLARY, ArrivalStamps
from swarmd.broker.sockets.medium import DatagramMedium, MediumDatagram, OnArrival
from swarmware.errors import ConfigError
from swarmware.model.clock import Clock
from swarmware.runtime.core import next_multiple_ns
from swarmware.runtime.instant import wait_s

TURN: Final = 64
"""Datagrams read from a socket before control returns to the event loop: about 3 ms."""
WINDOW_NS: Final = 50_000_000
"""Interval of batch reads while datagrams arrive faster than this: half a period of beacons,
and the period of the navigator, which runs after the broker has read.
A datagram costs 30 µs right after another one, several times that with cold caches
(`tests/bench/beacons.py`). The kernel's timestamps give the arrival of each."""
REST_WINDOW_NS: Final = 100_000_000
"""Interval of batch reads while nodes send at most four beacons a second, the rate at rest. The
members of a barrier leave 250 ms after it opens."""
REST_PERIOD_NS: Final = 250_000_000
DATAGRAM_MAX: Final = 2048
RECEIVE_BYTES: Final = 512 * 1024
LOOPBACK: Final = "127.0.0.1"

_IP_MULTICAST_ALL: Final = 49

log = logging.getLogger("swarm.broker")


class Network(msgspec.Struct, frozen=True):
    """Addresses of a network, and the keys of the configuration that name them."""

    medium: MediumProfile
    bind_address: str
    interface: str
    """Address or name, or "" for the kernel's choice."""
    group: Address | None
    unicast_port: int = 0
    window_ns: int | None = None
    """Interval of batch reads, or None if it follows the periods of beacons."""


def main_network(config: Config) -> Network:
    """The network of `bind_address` and `multicast_group`."""
    bound = config.bind_address if config.bind_address != EVERYWHERE else ""
    return Network(
        MAIN_MEDIUM,
        config.bind_address,
        config.multicast_interface or bound,
        (config.multicast_group, config.udp_port) if config.multicast_group else None,
        config.unicast_port,
    )


def further_network(config: NetworkMedium) -> Network:
    """A network beside the main one; what arrives there is taken at once, as it may be an urgent frame."""
    by_address = config.interface[:1].isdigit()
    return Network(
        network_medium(config),
        config.interface if by_address else EVERYWHERE,
        config.interface,
        (config.multicast_group, config.udp_port),
        window_ns=0,
    )


class Udp(DatagramMedium):
    """The UDP sockets of a network.

    Reception is coalesced as a network card's interrupts are: after a pause a datagram is taken at once, then
    the sockets are read by a timer until they are empty. The timer expires at multiples of the window on the
    node's clock, at the instants of the other periodic work of the process.
    """

    def __init__(
        self, network: Network, loop: asyncio.AbstractEventLoop, clock: Clock, on_arrival: OnArrival
    ) -> None:
        """Raises: ConfigError when an address, group or port cannot be used."""
        self._loop = loop
        self._clock = clock
        self._on_arrival = on_arrival
        self.medium = network.medium
        self._group = network.group
        self._timer: asyncio.TimerHandle | None = None
        self._taken = 0
        """Datagrams read since the timer was set, including those read before it expired."""
        # as if nothing had been read for a while; the first datagram is taken at once
        self._read_ns = clock.now_ns() - REST_WINDOW_NS
        self._window_ns = WINDOW_NS if network.window_ns is None else network.window_ns
        self._is_adaptive = network.window_ns is None
        self.send_errors = 0
        with contextlib.ExitStack() as stack:
            self._own = stack.enter_context(_own_socket(network))
            self._all: socket.socket | None = None
            if network.group is not None:
                self._all = stack.enter_context(_group_socket(network, network.group))
                _send_to_group(self._own, network, network.group)
            self._closing = stack.pop_all()
        self.port: int = self._own.getsockname()[1]
        """Our own UDP port: source of all our datagrams."""
        self._watch()

    @property
    def has_group(self) -> bool:
        """Whether a multicast group is configured."""
        return self._group is not None

    def send_to_all(self, data: bytes) -> bool:
        """Sends a datagram to the group; False when that failed."""
        return self._group is not None and self.send(data, self._group)

    def send(self, data: bytes, address: Address, *, urgent: bool = False) -> bool:
        """Sends a datagram to one node; False when that failed."""
        try:
            self._own.sendto(data, address)
        except OSError as error:
            # no route, buffer or interface: the next beacon may succeed
            self.send_errors += 1
            if self.send_errors == 1:
                log.warning("datagrams to %s:%d cannot be sent: %s", *address, error.strerror)
            return False
        return True

    def set_min_period(self, period_ns: int) -> None:
        """The usual time between two datagrams of one sender."""
        if self._is_adaptive:
            self._window_ns = WINDOW_NS if period_ns < REST_PERIOD_NS else REST_WINDOW_NS

    def receive(self) -> None:
        """Reads waiting datagrams, TURN per socket at most."""
        self._receive()

    def _receive(self) -> int:
        """Returns the larger count of the two sockets."""
        self._read_ns = self._clock.now_ns()
        stamps = ArrivalStamps()
        count = self._drain(self._own, False, stamps)
        if self._all is not None:
            count = max(count, self._drain(self._all, True, stamps))
        self._taken += count
        return count

    def _on_readable(self) -> None:
        pause_ns = self._clock.now_ns() - self._read_ns
        # datagrams come faster than the window; the timer collects them, and the loop is woken less often
        if self._receive() < TURN and pause_ns < self._window_ns:
            self._unwatch()
            self._set_timer()

    def _set_timer(self) -> None:
        self._taken = 0
        end_ns = next_multiple_ns(self._clock.now_ns(), self._window_ns)
        self._timer = self._loop.call_later(wait_s(self._clock, end_ns), self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        count = 0
        try:
            count = self._receive()
        finally:
            # datagrams still arrive; one more window; after a silent one the next datagram wakes the loop at
            # once
            if count < TURN and self._taken:
                self._set_timer()
            else:
                self._watch()

    def _watch(self) -> None:
        for sock in (self._own, self._all):
            if sock is not None:
                self._loop.add_reader(sock.fileno(), self._on_readable)

    def _unwatch(self) -> None:
        for sock in (self._own, self._all):
            if sock is not None and sock.fileno() >= 0:
                self._loop.remove_reader(sock.fileno())

    def _drain(self, sock: socket.socket, by_multicast: bool, stamps: ArrivalStamps) -> int:
        # bounded, so that a flood cannot keep the event loop from everything else
        receive, on_arrival = sock.recvmsg, self._on_arrival
        for count in range(TURN):
            try:
                data, ancillary, _, address = receive(DATAGRAM_MAX, ANCILLARY)
            except BlockingIOError:
                return count
            except OSError as error:
                log.debug("receiving datagrams: %s", error)
                return count
            rx_ns = stamps.mono_ns(ancillary)
            on_arrival(self.medium, MediumDatagram(data, address, rx_ns, by_multicast))
        return TURN

    def close(self) -> None:
        """Close the sockets and cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._unwatch()
        self._closing.close()


async def resolve(seed: str, loop: asyncio.AbstractEventLoop) -> Address | None:
    """Address of a seed `host:port`, or None if its name is not known now."""
    host, _, port = seed.rpartition(":")
    try:
        found = await loop.getaddrinfo(host, int(port), family=socket.AF_INET, type=socket.SOCK_DGRAM)
    except OSError as error:
        log.warning("seed %s: %s", seed, error.strerror)
        return None
    address: Address = found[0][4][:2]  # type: ignore[assignment]  # AF_INET addresses are (host, port)
    return address


def loopback_only(config: Config) -> Config:
    """The settings for a node that must not communicate with other computers."""
    return msgspec.structs.replace(
        config,
        bind_address=config.bind_address if config.bind_address.startswith("127.") else LOOPBACK,
        multicast_interface=LOOPBACK,
        serial=(),
        network=(),
        metrics_address=config.metrics_address if config.metrics_address.startswith("127.") else LOOPBACK,
    )


def _own_socket(network: Network) -> socket.socket:
    sock = _udp_socket()
    try:
        if network.medium.name != MAIN and network.bind_address == EVERYWHERE:
            # what leaves here must leave by this interface, whatever the routes are
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, network.interface.encode())
        sock.bind((network.bind_address, network.unicast_port))
    except OSError as error:
        sock.close()
        where = f"bind_address {network.bind_address}, unicast_port {network.unicast_port}"
        if network.medium.name != MAIN:
            where = f"network {network.medium.name}: interface {network.interface}"
        raise ConfigError(f"broker: {where}: {error.strerror}") from error
    return sock


def _group_socket(network: Network, group: Address) -> socket.socket:
    sock = _udp_socket()
    try:
        # several nodes of one machine listen on the same group and port, each gets a copy
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        sock.bind(group)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, _membership(group[0], network.interface))
    except OSError as error:
        sock.close()
        medium = network.medium.name
        where = "broker" if medium == MAIN else f"broker: network {medium}"
        raise ConfigError(
            f"{where}: multicast_group {group[0]}:{group[1]} on interface "
            f"{network.interface or 'of the kernel'!r}: "
            f"{error.strerror or error}; expected an IPv4 group such as 239.83.87.1, and the address or name"
            " of an interface"
        ) from error
    return sock


def _send_to_group(sock: socket.socket, network: Network, group: Address) -> None:
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    if network.interface:
        membership = _membership(group[0], network.interface)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, membership)


def _membership(group: str, interface: str) -> bytes:
    """Membership of a group as struct ip_mreqn, see ip(7)."""
    address, index = EVERYWHERE, 0
    if interface[:1].isdigit():
        address = interface
    elif interface:
        index = socket.if_nametoindex(interface)
    return struct.pack("@4s4si", socket.inet_aton(group), socket.inet_aton(address), index)


def _udp_socket() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    arrival_stamp.enable(sock)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
    return sock
