"""The interface of all media: datagrams to all nodes that a medium reaches, and to one neighbour."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import msgspec

from swarmd.broker.core.swarm.media.medium import Address, MediumProfile


class MediumDatagram(msgspec.Struct, frozen=True, gc=False):
    """A datagram that came over a medium."""

    data: bytes
    address: Address
    """Source address, or on a serial line the name of the medium."""
    rx_mono_ns: int
    """CLOCK_MONOTONIC at its arrival."""
    by_multicast: bool = True
    """The datagram went to all nodes of the medium."""
    number: int | None = None
    """Number of 16 bits that the medium gives its datagrams, or None if it gives none."""


OnArrival = Callable[[MediumProfile, MediumDatagram], None]
"""Called with the medium and what came over it."""

OnLine = Callable[[str, str], None]
"""Called with the name of a serial line and the reason for which it is not open, or "" when it is open."""


class DatagramMedium(ABC):
    """A medium that carries datagrams: networks and serial lines."""

    medium: MediumProfile

    @abstractmethod
    def send_to_all(self, data: bytes) -> bool:
        """Sends a beacon to all nodes that the medium reaches; False when that failed."""

    @abstractmethod
    def send(self, data: bytes, address: Address, *, urgent: bool = False) -> bool:
        """Sends a datagram to one neighbour; False when that failed."""

    @abstractmethod
    def receive(self) -> None:
        """Takes what waits, without the delay of batching."""

    @abstractmethod
    def close(self) -> None:
        """Closes the medium; nothing arrives any more."""
