"""Addresses of this computer, at which a node that joins reaches the inviter."""

import socket
from collections.abc import Mapping, Sequence
from ipaddress import ip_address
from typing import Final

from swarmware.errors import InvalidInput
from swarmware.transport.enrolment.token import HOSTS_MAX

PORT: Final = 7449
"""Default TCP port of the inviter, if it is free."""
_OF_CONTAINERS: Final = ("docker", "br-", "virbr", "lxc", "podman")
"""Prefixes of virtual interfaces, which only programs on this computer can reach."""


def own_addresses() -> tuple[str, ...]:
    """Addresses by which other computers may reach this one, or the loopback address without any."""
    import psutil

    stats = psutil.net_if_stats()
    up = {name: addresses for name, addresses in psutil.net_if_addrs().items() if stats[name].isup}
    found = {
        name: [one.address for one in addresses if one.family in {socket.AF_INET, socket.AF_INET6}]
        for name, addresses in up.items()
    }
    return reachable(found)


def reachable(addresses: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Addresses that other computers can use, from each interface: IPv4, else IPv6, else loopback."""
    parsed = [
        ip_address(text.partition("%")[0])
        for name, texts in addresses.items()
        if not name.startswith(_OF_CONTAINERS)
        for text in texts
    ]
    usable = [one for one in parsed if not (one.is_loopback or one.is_link_local)]
    chosen = [one for one in usable if one.version == 4] or usable
    return tuple(map(str, chosen[:HOSTS_MAX])) or ("127.0.0.1",)


def host_and_port(text: str) -> tuple[str, int]:
    """Host and port of an option HOST, HOST:PORT or [IPV6]:PORT; the port is 0 if it is left out.

    Raises: InvalidInput for any other text.
    """
    host, colon, port = text.rpartition(":")
    if not colon or (":" in host and not host.endswith("]")):
        host, port = text, "0"  # a name, or an IPv6 address without brackets
    elif port == "0":
        port = ""
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) >= 1 << 16:
        raise InvalidInput(f"address {text!r}: expected HOST, HOST:PORT or [IPV6]:PORT")
    return host, int(port)
