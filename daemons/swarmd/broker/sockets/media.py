"""All media of a node: opened by the configuration, and what arrives over them by its kind."""

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Final

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec
from swarmd.broker.core.swarm.media.medium import Address, MediumProfile
from swarmd.broker.core.swarm.neighbours.medium_table import MediumAddress, MediumTable, Use
from swarmd.broker.sockets.medium import DatagramMedium, MediumDatagram, OnArrival, OnLine
from swarmd.broker.sockets.serial_medium import SerialLineMedium
from swarmd.broker.sockets.udp import Udp, further_network, main_network
from swarmware.model.clock import Clock
from swarmware.types.traffic import Refused


class Media:
    """The networks and serial lines of a node."""

    def __init__(
        self,
        config: Config,
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        refused: Refused,
        *,
        on_beacon: OnArrival,
        on_frame: OnArrival,
        on_line: OnLine = lambda _name, _problem: None,
    ) -> None:
        """`on_frame`: takes any other datagram; `on_line`: called for serial lines that open or are lost.

        Raises: ConfigError when an address, group or port cannot be used.
        """
        self._on_beacon = on_beacon
        self._on_frame = on_frame
        with contextlib.ExitStack() as stack:
            self.main = stack.enter_context(
                contextlib.closing(Udp(main_network(config), loop, clock, on_beacon))
            )
            """The network of the addresses in hellos."""
            further: list[DatagramMedium] = []
            for network in config.network:
                found = Udp(further_network(network), loop, clock, self._take)
                further.append(stack.enter_context(contextlib.closing(found)))
            for line in config.serial:
                port = SerialLineMedium(line, loop, refused, self._take, on_line)
                further.append(stack.enter_context(contextlib.closing(port)))
            self._closing = stack.pop_all()
        self._further: Final = {one.medium.number: one for one in further}

    @property
    def profiles(self) -> list[MediumProfile]:
        """All media of this node."""
        return [self.main.medium, *(one.medium for one in self._further.values())]

    @property
    def further(self) -> list[DatagramMedium]:
        """The media beside the main network."""
        return list(self._further.values())

    def receive(self) -> None:
        """Takes what waits in all media."""
        self.main.receive()
        for one in self._further.values():
            one.receive()

    def send(self, medium: MediumProfile, data: bytes, address: Address, *, urgent: bool) -> bool:
        """Sends a datagram to a neighbour by one of the media beside the main network."""
        found = self._further.get(medium.number)
        return found is not None and found.send(data, address, urgent=urgent)

    def _take(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        is_beacon = arrival.data[:1] == bytes([beacon_codec.MAGIC])
        (self._on_beacon if is_beacon else self._on_frame)(medium, arrival)

    def close(self) -> None:
        """Closes all networks and lines."""
        self._closing.close()


class MediaLinks:
    """Sends by the media that the core has chosen for a neighbour."""

    def __init__(self, media: Media, table: MediumTable, clock: Clock) -> None:
        self._media = media
        self._table = table
        self._clock = clock

    def ways(self, hw: int, use: Use) -> Sequence[MediumAddress]:
        """The media to a neighbour for this use."""
        return self._table.ways(hw, use, self._clock.now_ns())

    def send(self, way: MediumAddress, datagram: bytes, *, urgent: bool) -> bool:
        """Sends by a medium beside the main network; False when it did not take it."""
        return self._media.send(way.medium, datagram, way.address, urgent=urgent)

    def on_packet(self, hw: int, medium: MediumProfile) -> None:
        """A packet of a neighbour came by a medium."""
        self._table.on_frames(hw, medium.number, self._clock.now_ns())
