"""Several media at once: which copies are new, how good each medium is, and which one carries what."""

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.config import Carries, Config
from swarmd.broker.core.beacon.beacon import NEVER_NS, Header
from swarmd.broker.core.beacon.parts.medium_parts import LISTING_BYTES, MediumListing
from swarmd.broker.core.swarm.media.line_frames import line_bytes
from swarmd.broker.core.swarm.media.medium import (
    BEACON_SHARE,
    MAIN_MEDIUM,
    PERFECT,
    Address,
    MediumProfile,
    network_medium,
    serial_medium,
)
from swarmd.broker.core.swarm.media.medium_link import MediumLink
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmware.types.net import LinkTransport

HYSTERESIS: Final = 96
"""Required improvement of another medium, as of another next hop."""
LISTING_NS: Final = 400_000_000
"""Every medium by which a neighbour is received is listed in this period."""
FORGET_NS: Final = 60_000_000_000
"""A silent medium is listed, and shown, for this time."""


class Use(Enum):
    """Kind of traffic to a neighbour."""

    URGENT = "urgent"
    """An urgent frame: on all media, its copies are recognised."""
    PACKETS = "packets"
    """Packets of the reliable link, and connections: on the best medium."""


class MediumAddress(NamedTuple):
    """A medium to a neighbour, and the neighbour's address there."""

    medium: MediumProfile
    address: Address


class ByMedium(NamedTuple):
    """How a beacon came: the medium, and the number of the datagram there."""

    medium: MediumProfile
    number: int


class MediumChanged(msgspec.Struct, frozen=True):
    """Action: frames to a neighbour take another medium from now on."""

    hw: int


class MediumTable:
    """The media of this node, and the choice among them.

    The links over each medium are in the record of the neighbour, as they begin and end with its session.
    """

    def __init__(
        self,
        own_hw: int,
        media: Sequence[MediumProfile],
        link_timeout_ns: int,
        neighbours: NeighbourTable,
    ) -> None:
        self.media = {medium.number: medium for medium in media}
        self._own_hw = own_hw
        self._timeout_ns = link_timeout_ns
        self._neighbours = neighbours
        self._listed_ns = NEVER_NS
        self._listed_first = 0
        """Position of the first link in the next listing."""
        self._unlisted = 0
        """Links for which the listings of this period had no room yet."""

    # input

    def is_copy(self, header: Header, by: ByMedium) -> bool:
        """Whether a beacon has no new content: it came over another medium before, or over a payload link,
        which makes no neighbours of its own."""
        # a link for payload makes no neighbours; what it says of them came by the other media, too
        if by.medium.carries is Carries.PAYLOAD:
            return True
        known = self._neighbours.get(header.sender_hw)
        return known is not None and known.session == header.session and not known.is_new(header.sequence)

    def address_on_main(self, header: Header, by: ByMedium, address: Address) -> Address:
        """Address of the sender on the main network, or on the medium of this beacon until it is known."""
        known = self._neighbours.get(header.sender_hw)
        if by.medium.number == MAIN_MEDIUM.number or known is None or known.session != header.session:
            return address
        link = known.media.get(MAIN_MEDIUM.number)
        return address if link is None else link.address

    def on_copy(self, hw: int, by: ByMedium, address: Address, now_ns: int) -> None:
        """Counts a copy of a beacon for the medium by which it came."""
        known = self._neighbours.get(hw)
        if known is not None:
            self._on_arrival(known, by, address, now_ns)

    def on_beacon(
        self,
        neighbour: Neighbour,
        by: ByMedium,
        address: Address,
        listings: Iterable[MediumListing],
        now_ns: int,
    ) -> None:
        """Takes the first copy of a beacon, with the media by which its sender receives which nodes."""
        self._on_arrival(neighbour, by, address, now_ns)
        for listing in listings:
            neighbour.lists_media = True
            link = neighbour.media.get(listing.medium)
            # a listing alone makes no link; the medium must have brought a beacon of the neighbour itself
            if listing.hw == self._own_hw and link is not None:
                link.on_listed(listing.quality, now_ns)
        if not neighbour.lists_media and (link := neighbour.media.get(MAIN_MEDIUM.number)) is not None:
            # a node that lists no media has the main network alone: its echoes report the loss there
            link.on_listed(neighbour.quality_out, now_ns)

    def _on_arrival(self, neighbour: Neighbour, by: ByMedium, address: Address, now_ns: int) -> None:
        number = by.medium.number
        link = neighbour.media.get(number)
        if link is None:
            link = neighbour.media[number] = MediumLink(self.media[number], self._timeout_ns)
        link.on_arrival(by.number, address, neighbour.period_ns, now_ns)

    def on_frames(self, hw: int, medium: int, now_ns: int) -> None:
        """Notes the medium that a neighbour has chosen for its packets to this node."""
        known = self._neighbours.get(hw)
        link = None if known is None else known.media.get(medium)
        if link is not None:
            link.frames_ns = now_ns

    def advance(self, now_ns: int) -> list[int]:
        """Chooses the media for packets again; returns the neighbours whose choice has changed."""
        changed: list[int] = []
        for known in self._neighbours.all():
            for number, link in list(known.media.items()):
                if link.silent_ns(now_ns) > FORGET_NS:
                    del known.media[number]
            best = self._choose(known, now_ns)
            if best != known.best_medium:
                known.best_medium = best
                known.penalty = 0 if best is None else self.media[best].rate_penalty
                changed.append(known.hw)
        return changed

    def _choose(self, known: Neighbour, now_ns: int) -> int | None:
        up = [(number, link) for number, link in known.media.items() if link.is_up(now_ns)]
        # in the order of preference; a medium of a lower rank is used only where no better one is up
        for wanted in (Carries.PAYLOAD, Carries.ALL, Carries.CONTROL):
            costs = {number: link.cost_out(now_ns) for number, link in up if link.medium.carries is wanted}
            if not costs:
                continue
            best = min(costs, key=lambda number: costs[number])
            present = costs.get(known.best_medium) if known.best_medium is not None else None
            # hysteresis; packets of one frame on two media would arrive out of order
            is_kept = present is not None and present <= costs[best] + HYSTERESIS
            return known.best_medium if is_kept else best
        return None

    def deadline_ns(self, now_ns: int) -> int | None:
        """When the medium of some packets becomes silent, or None if no medium is used."""
        used = [best.deadline_ns for one in self._neighbours.all() if (best := one.best_link) is not None]
        return min((due_ns for due_ns in used if due_ns > now_ns), default=None)

    # output

    def listings(self, now_ns: int, room: int) -> tuple[MediumListing, ...]:
        """The media by which neighbours are received, for the next beacon, if they are due; listings without
        room are the first of the beacon after it."""
        is_due = now_ns - self._listed_ns >= LISTING_NS
        if not is_due and not self._unlisted:
            return ()
        found = [
            MediumListing(known.hw, number, link.quality_in(now_ns))
            for known in self._neighbours.all()
            for number, link in known.media.items()
        ]
        if is_due:
            self._listed_ns, self._unlisted = now_ns, len(found)
        count = min(len(found), self._unlisted, max(0, room // LISTING_BYTES))
        self._unlisted -= count
        # round robin over the beacons, so that each link is listed before the other end gives it up
        first = self._listed_first % max(1, len(found))
        self._listed_first = first + count
        return tuple((found[first:] + found[:first])[:count])

    def beacon_hz(self, datagram_bytes: float, now_ns: int) -> float:
        """Beacons per second that reach every neighbour by one of its media."""
        rates = [
            max(_beacon_hz(one.medium, datagram_bytes) for one in received)
            for known in self._neighbours.all()
            if (received := [link for link in known.media.values() if link.is_received(now_ns)])
        ]
        if rates:
            return min(rates)
        return max(_beacon_hz(medium, datagram_bytes) for medium in self.media.values())

    def ways(self, hw: int, use: Use, now_ns: int) -> list[MediumAddress]:
        """By which media something goes to a neighbour; none when it is not received."""
        known = self._neighbours.get(hw)
        if known is None:
            return []
        if use is Use.PACKETS:
            link = known.best_link
            return [] if link is None else [MediumAddress(link.medium, link.address)]
        up = [one for one in known.media.values() if one.is_up(now_ns)]
        # commands go by media for payload only where nothing else is left
        fit = [one for one in up if one.medium.carries is not Carries.PAYLOAD] or up
        return [MediumAddress(one.medium, one.address) for one in fit]


def connection_host(neighbour: Neighbour) -> str:
    """Address to which connections to a neighbour go, or "" if the medium of its packets has none.

    Until a medium is known to work in both directions, connections go to the source address of the newest
    beacon: a session is proven over a connection before the neighbour reports any loss.
    """
    best = neighbour.best_link
    links = neighbour.media.values() if best is None else [best]
    hosts = [(link.deadline_ns, link.address[0]) for link in links if link.medium.has_connections]
    return max(hosts)[1] if hosts else ""


def _beacon_hz(medium: MediumProfile, datagram_bytes: float) -> float:
    if not medium.rate_bit_s:
        return float(PERFECT)  # no limit of its own: the air has one
    return BEACON_SHARE * medium.rate_bit_s / (8 * line_bytes(datagram_bytes))


def media_of(own_hw: int, config: Config, neighbours: NeighbourTable) -> MediumTable | None:
    """The table of a node with several media, or None on a node with one network."""
    if not config.serial and not config.network:
        return None
    media = [MAIN_MEDIUM, *map(network_medium, config.network), *map(serial_medium, config.serial)]
    return MediumTable(own_hw, media, round(config.link_timeout_s * 1e9), neighbours)


def transport_of(by: ByMedium | None) -> LinkTransport:
    """Kind of the medium in the counters; `by`: None on a node with one network."""
    return LinkTransport.UDP if by is None else by.medium.transport
