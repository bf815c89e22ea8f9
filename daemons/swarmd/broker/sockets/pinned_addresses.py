"""Addresses and interfaces that the configuration names: whether this computer still has them."""

import fcntl
import socket
import struct
from typing import Final

from swarmd.broker.config import EVERYWHERE, Config

_SIOCGIFADDR: Final = 0x8915
"""Request for the first IPv4 address of an interface. Source: netdevice(7)."""
_IFREQ: Final = struct.Struct("16s24x")


class PinnedAddresses:
    """Finds addresses that have left this computer, as after a change by DHCP or without the interface.

    Sockets that are bound to such an address stay open and neither send nor receive, without an error.
    """

    def __init__(self, config: Config) -> None:
        named = {
            f"bind_address {config.bind_address}": config.bind_address,
            f"multicast_interface {config.multicast_interface}": config.multicast_interface,
            **{f"network {one.name}: interface {one.interface}": one.interface for one in config.network},
        }
        self._named = {key: place for key, place in named.items() if place not in {"", EVERYWHERE}}
        self._interfaces = {place: _interface_of(place) for place in self._named.values()}

    def missing(self) -> str:
        """The keys whose address or interface this computer does not have now, or none if it has all."""
        return "; ".join(self._lost(key, place) for key, place in self._named.items() if not _is_here(place))

    def _lost(self, key: str, place: str) -> str:
        name = self._interfaces[place]
        where = f", which interface {name} had at the start" if name else ""
        return f"{key}{where}: this computer does not have it now"


def _is_here(place: str) -> bool:
    """Whether an address can be bound, or an interface exists."""
    try:
        if not place[:1].isdigit():
            socket.if_nametoindex(place)
            return True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((place, 0))
    except OSError:  # no such address or interface: all that is asked here
        return False
    return True


def _interface_of(address: str) -> str:
    """Name of the interface that has this address as its first one, or "" if none has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            try:
                found = fcntl.ioctl(probe, _SIOCGIFADDR, _IFREQ.pack(name.encode()))
            except OSError:
                continue  # it has no IPv4 address
            if socket.inet_ntoa(found[20:24]) == address:
                return name
    return ""
