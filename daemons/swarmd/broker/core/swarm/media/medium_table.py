"""Several media at once: which copies are new, how good each medium is, and which one carries what."""

from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import Final, NamedTuple

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
    medium_number,
    network_medium,
    serial_medium,
)
from swarmd.broker.core.swarm.media.medium_link import MediumLink
from swarmware.types.net import LinkTransport

HYSTERESIS: Final = 96
"""Required improvement of another medium, as of another next hop."""
WINDOW: Final = 64
"""Beacons in which copies are recognised: the replay window of the seals."""
_WINDOW_MASK: Final = (1 << WINDOW) - 1
LISTING_NS: Final = 400_000_000
"""Every medium by which a neighbour is received is listed in this period."""
FORGET_NS: Final = 60_000_000_000
"""A silent medium is listed, and shown, for this time."""


class Use(Enum):
    """What is to be sent to a neighbour."""

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


class _Neighbour:
    __slots__ = ("best", "links", "lists", "seen", "session", "top")

    def __init__(self, session: int) -> None:
        self.session = session
        self.top = -1
        self.seen = 0
        self.links: dict[int, MediumLink] = {}
        self.best: int | None = None
        """Number of the medium of its packets."""
        self.lists = False
        """It lists media, so it has several."""


class MediumTable:
    """The media of this node, and their links to all neighbours."""

    def __init__(
        self,
        own_hw: int,
        media: Sequence[MediumProfile],
        link_timeout_ns: int,
        period_of: Callable[[int], int],
    ) -> None:
        """`period_of`: between two beacons of a neighbour, as it declares."""
        self._period_of = period_of
        self.media = {medium.number: medium for medium in media}
        self._own_hw = own_hw
        self._timeout_ns = link_timeout_ns
        self._neighbours: dict[int, _Neighbour] = {}
        self._listed_ns = NEVER_NS
        self._listed_first = 0
        """Position of the first link in the next listing."""
        self._unlisted = 0
        """Links for which the listings of this period had no room yet."""

    # input

    def is_first(self, hw: int, session: int, sequence: int) -> bool:
        """Whether a beacon is new, not a copy of one that came over another medium."""
        known = self._neighbours.get(hw)
        if known is None or known.session != session:
            return True
        ahead = sequence - known.top
        return ahead > 0 or (ahead > -WINDOW and not known.seen >> -ahead & 1)

    def is_copy(self, header: Header, by: ByMedium) -> bool:
        """Whether a beacon says nothing new: it came over another medium before, or over a payload link,
        whose neighbours are those of the other media."""
        assert header.session is not None
        if by.medium.carries is Carries.PAYLOAD:
            return True
        return not self.is_first(header.sender_hw, header.session, header.sequence)

    def on_beacon(self, header: Header, by: ByMedium, address: Address, now_ns: int) -> None:
        """A beacon of the accepted session of a node."""
        hw, session, sequence, medium = header.sender_hw, header.session, header.sequence, by.medium.number
        assert session is not None
        known = self._neighbours.get(hw)
        if known is None or known.session != session:
            known = self._neighbours[hw] = _Neighbour(session)
        ahead = sequence - known.top
        if by.medium.carries is not Carries.PAYLOAD:
            if ahead > 0:
                known.seen = (known.seen << ahead | 1) & _WINDOW_MASK if ahead < WINDOW else 1
                known.top = sequence
            elif ahead > -WINDOW:
                known.seen |= 1 << -ahead
        link = known.links.get(medium)
        if link is None:
            link = known.links[medium] = MediumLink(self.media[medium], self._timeout_ns)
        link.on_arrival(by.number, address, self._period_of(hw), now_ns)

    def on_listings(self, hw: int, listings: Iterable[MediumListing], now_ns: int) -> None:
        """A neighbour says by which media it receives whom."""
        known = self._neighbours.get(hw)
        if known is None:
            return
        for listing in listings:
            known.lists = True
            link = known.links.get(listing.medium)
            if listing.hw == self._own_hw and link is not None:
                link.on_listed(listing.quality, now_ns)

    def on_reported(self, hw: int, quality: int, now_ns: int) -> None:
        """A neighbour reports which share of our beacons it receives, in 1/255; one that lists no media has
        the main network alone."""
        known = self._neighbours.get(hw)
        link = None if known is None or known.lists else known.links.get(MAIN_MEDIUM.number)
        if link is not None:
            link.on_listed(quality, now_ns)

    def on_frames(self, hw: int, medium: int, now_ns: int) -> None:
        """Packets of a neighbour arrived by a medium: its choice for this direction."""
        known = self._neighbours.get(hw)
        link = None if known is None else known.links.get(medium)
        if link is not None:
            link.frames_ns = now_ns

    def advance(self, now_ns: int) -> list[int]:
        """Chooses the media for packets again; returns the neighbours whose choice has changed."""
        changed: list[int] = []
        for hw, known in list(self._neighbours.items()):
            for number, link in list(known.links.items()):
                if link.silent_ns(now_ns) > FORGET_NS:
                    del known.links[number]
            if not known.links:
                del self._neighbours[hw]
            best = self._choose(known, now_ns)
            if best != known.best:
                known.best = best
                changed.append(hw)
        return changed

    def _choose(self, known: _Neighbour, now_ns: int) -> int | None:
        up = [(number, link) for number, link in known.links.items() if link.is_up(now_ns)]
        for wanted in (Carries.PAYLOAD, Carries.ALL, Carries.CONTROL):
            costs = {number: link.cost_out(now_ns) for number, link in up if link.medium.carries is wanted}
            if not costs:
                continue
            best = min(costs, key=lambda number: costs[number])
            present = costs.get(known.best) if known.best is not None else None
            return known.best if present is not None and present <= costs[best] + HYSTERESIS else best
        return None

    def deadline_ns(self, now_ns: int) -> int | None:
        """When the medium of some packets becomes silent; None: none is used."""
        used = [
            known.links[known.best].deadline_ns
            for known in self._neighbours.values()
            if known.best is not None and known.best in known.links
        ]
        return min((one for one in used if one > now_ns), default=None)

    # output

    def listings(self, now_ns: int, room: int) -> tuple[MediumListing, ...]:
        """The media by which neighbours are received, for the next beacon, if they are due; those for which
        it has no room are the first of the next one."""
        is_due = now_ns - self._listed_ns >= LISTING_NS
        if not is_due and not self._unlisted:
            return ()
        found = [
            MediumListing(hw, number, link.quality_in(now_ns))
            for hw, known in self._neighbours.items()
            for number, link in known.links.items()
        ]
        if is_due:
            self._listed_ns, self._unlisted = now_ns, len(found)
        count = min(len(found), self._unlisted, max(0, room // LISTING_BYTES))
        self._unlisted -= count
        first = self._listed_first % max(1, len(found))
        self._listed_first = first + count
        return tuple((found[first:] + found[:first])[:count])

    def beacon_hz(self, datagram_bytes: float, now_ns: int) -> float:
        """Beacons per second that reach every neighbour by one of its media."""
        rates = [
            max(_beacon_hz(one.medium, datagram_bytes) for one in received)
            for known in self._neighbours.values()
            if (received := [link for link in known.links.values() if link.is_received(now_ns)])
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
            link = known.links.get(known.best) if known.best is not None else None
            return [] if link is None else [MediumAddress(link.medium, link.address)]
        up = [one for one in known.links.values() if one.is_up(now_ns)]
        fit = [one for one in up if one.medium.carries is not Carries.PAYLOAD] or up
        return [MediumAddress(one.medium, one.address) for one in fit]

    def penalty(self, hw: int) -> int:
        """What the rate of its medium adds to the cost of a neighbour."""
        known = self._neighbours.get(hw)
        if known is None or known.best is None:
            return 0
        return self.media[known.best].rate_penalty

    def address(self, hw: int, name: str) -> Address | None:
        """Address of a neighbour on a medium; None: it was not received by that."""
        known = self._neighbours.get(hw)
        link = None if known is None else known.links.get(medium_number(name))
        return None if link is None else link.address

    def host(self, hw: int) -> str:
        """Address to which connections to a neighbour go; empty: the medium of its packets has none.

        As long as none is known to work in both directions, that of its newest datagram: a session is proven
        over a connection before the neighbour reports anything.
        """
        best = self.best(hw)
        links = self.links(hw) if best is None else [best]
        hosts = [(link.deadline_ns, link.address[0]) for link in links if link.medium.has_connections]
        return max(hosts)[1] if hosts else ""

    def links(self, hw: int) -> list[MediumLink]:
        """The links to a neighbour over all media."""
        known = self._neighbours.get(hw)
        return [] if known is None else list(known.links.values())

    def best(self, hw: int) -> MediumLink | None:
        """The link that carries the packets to a neighbour."""
        known = self._neighbours.get(hw)
        return None if known is None or known.best is None else known.links.get(known.best)


def _beacon_hz(medium: MediumProfile, datagram_bytes: float) -> float:
    if not medium.rate_bit_s:
        return float(PERFECT)  # no limit of its own: the air has one
    return BEACON_SHARE * medium.rate_bit_s / (8 * line_bytes(datagram_bytes))


def media_of(own_hw: int, config: Config, period_of: Callable[[int], int]) -> MediumTable | None:
    """The table of a node with several media; None: it has one network."""
    if not config.serial and not config.network:
        return None
    media = [MAIN_MEDIUM, *map(network_medium, config.network), *map(serial_medium, config.serial)]
    return MediumTable(own_hw, media, round(config.link_timeout_s * 1e9), period_of)


def transport_of(by: ByMedium | None) -> LinkTransport:
    """Kind of the medium in the counters; None: the only network."""
    return LinkTransport.UDP if by is None else by.medium.transport
