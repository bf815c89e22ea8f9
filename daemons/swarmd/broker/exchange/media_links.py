"""Media to neighbours: what the core has chosen, and the media of this node that carry it."""

from collections.abc import Sequence

from swarmd.broker.core.swarm.media.medium import MediumProfile
from swarmd.broker.core.swarm.media.medium_table import MediumAddress, MediumTable, Use
from swarmd.broker.sockets.media import Media
from swarmware.model.clock import Clock


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
