"""Settings of the broker (services/broker.toml)."""

from collections import Counter
from enum import StrEnum
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput

Port = Annotated[int, msgspec.Meta(ge=0, le=65_535)]
GroupPort = Annotated[int, msgspec.Meta(ge=1, le=65_535)]
Platform = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,30}$")]
Delay = Annotated[float, msgspec.Meta(ge=0, le=1000)]
Seed = Annotated[str, msgspec.Meta(min_length=3, max_length=260)]
"""`host:port`; checked by `Config`, whose refusal says more than a pattern could."""


class FrameCarrier(StrEnum):
    """Carrier of the frames to neighbours."""

    AUTO = "auto"
    TCP = "tcp"
    UDP = "udp"


class Carries(StrEnum):
    """Use of a medium."""

    ALL = "all"
    PAYLOAD = "payload"
    """Streams, files and all else except commands, and that before other media."""
    CONTROL = "control"
    """Beacons and commands; other frames where no other medium is left."""


EVERYWHERE: Final = "0.0.0.0"
"""As `bind_address`: all addresses of the node."""
MAIN: Final = "main"
"""Name of the network of `bind_address` and `multicast_group`."""
MediumName = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,15}$")]


class SerialMedium(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A serial line, or a radio modem on one, that carries datagrams to neighbours."""

    name: MediumName
    """Name of the medium, the same at both ends."""
    device: str
    """Device file of the line."""
    baud: Annotated[int, msgspec.Meta(ge=300, le=4_000_000)] = 57_600
    """Rate of the line, and pace of what is written; of a modem the rate in the air, if that is less."""
    carries: Carries = Carries.ALL
    """all; payload: streams, files and all other frames except commands, before other media; control:
    beacons and commands."""


class NetworkMedium(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A second network, such as another radio, that carries datagrams to neighbours."""

    name: MediumName
    """Name of the medium, the same at both ends."""
    interface: str
    """Address of its network interface here, or the name of the interface."""
    multicast_group: str = "239.83.87.1"
    """IPv4 group of the beacons on this network."""
    udp_port: GroupPort = 7447
    """Port of the group."""
    rate_bit_s: Annotated[float, msgspec.Meta(ge=0, le=1e10)] = 0.0
    """Rate of the network, which limits beacons and counts in the cost of its links, or 0 if not known."""
    carries: Carries = Carries.ALL
    """all; payload: streams, files and all other frames except commands, before other media; control:
    beacons and commands."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Addresses, peers and rates of the broker."""

    multicast_group: str = "239.83.87.1"
    """IPv4 group of the beacons, or "" to reach seeds only, without multicast."""
    multicast_interface: str = ""
    """Address or name of the group's network interface, or "" for the interface of bind_address or the
    kernel's choice."""
    udp_port: GroupPort = 7447
    """Port of the group."""
    bind_address: str = EVERYWHERE
    """Address on which datagrams of single nodes and ZeroMQ connections are taken."""
    unicast_port: Port = 0
    """UDP port of this node alone, or 0 for any; set it where others name this node as a seed."""
    tcp_port: Port = 0
    """ZeroMQ port, and UDP port for small frames; neighbours learn both from the beacon. 0: any."""
    seeds: tuple[Seed, ...] = ()
    """Nodes that get beacons by unicast where multicast does not work, as host:port."""
    hear_only: tuple[Platform, ...] = ()
    """Platforms whose datagrams are accepted, or [] for all. Forms multi-hop swarms on one machine."""
    tick_hz: Annotated[float, msgspec.Meta(ge=1, le=50)] = 10.0
    """Beacon rate while boards of this node have subscribers and change; at least 5 Hz while links change,
    otherwise 2 Hz. Each rate is lower where the channel is congested."""
    link_timeout_s: Annotated[float, msgspec.Meta(ge=0.2, le=60)] = 1.0
    """Silence after which the link to a neighbour is down; 2.5 of its beacon periods where that is longer."""
    unit_delay_ms: tuple[Delay, ...] = ()
    """Simulated delay of the frames of other units of this platform, for the lab: its shortest and longest
    value, or [] without a delay."""
    relay_bytes_s: Annotated[float, msgspec.Meta(ge=0, le=1_000_000)] = 5000.0
    """Budget for relaying boards of other nodes with their proofs, in bytes per second."""
    frames: FrameCarrier = FrameCarrier.AUTO
    """Carrier of frames to neighbours: tcp, udp (acknowledged datagrams), or auto: udp where a link loses
    packets, tcp elsewhere."""
    outages: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 100
    """Number of finished outages of links that the node keeps, also over a restart."""
    metrics_port: Port = 0
    """TCP port of the metrics page for Prometheus, or 0 if it is not served."""
    metrics_address: str = "127.0.0.1"
    """Address of the metrics page; an address that other computers reach needs `metrics_token_file`."""
    metrics_token_file: str = ""
    """File with the bearer token that a request must have, or "" if none is needed."""
    heartbeat_s: Annotated[float, msgspec.Meta(ge=0, le=60)] = 0.0
    """Period of ZeroMQ heartbeats on connections, or 0 without: missing beacons show a lost neighbour."""

    serial: tuple[SerialMedium, ...] = ()
    """Serial lines beside the network, or in place of it."""
    network: tuple[NetworkMedium, ...] = ()
    """Further networks beside the first one."""

    def __post_init__(self) -> None:
        names = Counter([MAIN, *(one.name for one in self.serial), *(one.name for one in self.network)])
        twice = [name for name, count in names.items() if count > 1]
        if twice:
            raise InvalidInput(f"media: the name {twice[0]!r} twice; expected one medium of each name")
        if self.metrics_port and not self.metrics_address.startswith("127.") and not self.metrics_token_file:
            raise InvalidInput(
                f"metrics_address {self.metrics_address}: others than this computer reach it; expected an"
                " address that begins with 127., or metrics_token_file"
            )
        _check_addresses(self)
        delays = self.unit_delay_ms
        if delays and (len(delays) != 2 or delays[0] > delays[1]):
            found = ", ".join(f"{delay:g}" for delay in delays)
            raise InvalidInput(f"unit_delay_ms: {found}; expected two values, the shorter one first")


def _check_addresses(config: Config) -> None:
    """Raises: InvalidInput for an address that is not one of IPv4, the only protocol of the links."""
    named = {
        "bind_address": config.bind_address,
        "multicast_interface": config.multicast_interface,
        "multicast_group": config.multicast_group,
        "metrics_address": config.metrics_address,
    }
    for one in config.network:
        named[f"network {one.name}: interface"] = one.interface
        named[f"network {one.name}: multicast_group"] = one.multicast_group
    for key, value in named.items():
        if ":" in value:
            raise InvalidInput(f"{key} {value!r}: IPv4 only; expected an address such as 192.168.1.5")
        if key.endswith("multicast_group") and value and not _is_group(value):
            raise InvalidInput(f"{key} {value!r}: expected an IPv4 group, 224.0.0.0 to 239.255.255.255")
    for seed in config.seeds:
        host, _, port = seed.rpartition(":")
        if ":" in host or "[" in host:
            raise InvalidInput(f"seed {seed!r}: IPv4 only; expected host:port, such as 192.168.1.5:7447")
        if (
            not host
            or len(host.split()) != 1
            or not (port.isascii() and port.isdigit() and int(port) < 65_536)
        ):
            raise InvalidInput(f"seed {seed!r}: expected host:port, such as 192.168.1.5:7447")


def _is_group(value: str) -> bool:
    parts = value.split(".")
    numbers = [int(part) for part in parts if part.isascii() and part.isdigit() and len(part) <= 3]
    return len(parts) == len(numbers) == 4 and max(numbers) < 256 and 224 <= numbers[0] < 240
