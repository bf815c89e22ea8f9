"""The reliable links of a node: which neighbours get their frames in datagrams, and their sessions.

TCP recovers slowly from loss without congestion: at 30 % a connection stops for seconds. And it fills the
queue of a slow link, in which beacons and commands wait. So frames travel over TCP where a link is clean and
fast enough, and in datagrams where its beacons are lost or late, or frames wait for a queue.
"""

from typing import TYPE_CHECKING, Final

import msgspec

from swarmd.broker.config import Config, FrameCarrier
from swarmd.broker.core.frames.carrier import CLEAN, Carrier, LinkQuality
from swarmd.broker.core.frames.reliable.link_action import LinkAction
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.neighbours.link import ConnectionDelay

if TYPE_CHECKING:
    from swarmd.broker.core.frames.reliable.reliable_link import ReliableLink

CHECK_NS: Final = 40_000_000
"""Time between two measurements of a connection for which frames wait."""
OUTAGE: Final = 0.7
"""Loss of the last beacons from which on the link itself, not a firewall, stops the datagrams."""
BLOCKED_NS: Final = 60_000_000_000
"""Time after which a neighbour that did not acknowledge datagrams gets them again."""


UNKNOWN: Final = LinkQuality(0.0)


class UseConnection(msgspec.Struct, frozen=True):
    """Action: send these frames over the connection; the neighbour does not get the datagrams."""

    hw: int
    frames: list[QueuedFrame]


class UseDatagrams(msgspec.Struct, frozen=True):
    """Action: pass the frames that wait for the connection to a neighbour to its reliable link."""

    hw: int


class MeasureConnection(msgspec.Struct, frozen=True):
    """Action: call `on_connection` with the delay of the connections to a neighbour."""

    hw: int


class SetBuffer(msgspec.Struct, frozen=True):
    """Action: the connections to a neighbour have a send buffer of this size."""

    hw: int
    size: int


Action = LinkAction | UseConnection | UseDatagrams | MeasureConnection | SetBuffer


class ReliableLinks:
    """Reliable links by neighbour, and the choice between them and connections."""

    def __init__(self, config: Config) -> None:
        self._kind = config.frames
        self._links: dict[int, ReliableLink] = {}
        self._carriers: dict[int, Carrier] = {}
        self._qualities: dict[int, LinkQuality] = {}
        self._checks: dict[int, int] = {}
        """When the connections to a neighbour are measured, because frames wait for them."""

    def uses_datagrams(self, hw: int) -> bool:
        """Whether frames for a neighbour travel in datagrams."""
        carrier = self._carriers.get(hw)
        return carrier is not None and carrier.by_datagram

    def is_clean(self, hw: int) -> bool:
        """Whether frames for a neighbour travel over a connection of whose beacons nearly none is lost or
        late."""
        carrier = self._carriers.get(hw)
        return carrier is not None and self._kind is FrameCarrier.AUTO and carrier.is_clean

    def link(self, hw: int) -> "ReliableLink | None":
        """The reliable link of a neighbour, if there is one."""
        return self._links.get(hw)

    def links(self) -> "list[ReliableLink]":
        """The reliable links to all neighbours."""
        return list(self._links.values())

    def on_quality(self, hw: int, quality: LinkQuality, now_ns: int) -> list[Action]:
        """What beacons measure of the link to a neighbour, once a second while it is up."""
        self._qualities[hw] = quality
        carrier = self._carrier(hw)
        carrier.on_quality(quality)
        link = self._links.get(hw)
        if link is not None:
            link.rate.on_link_loss(carrier.loss)
            if link.is_blocked and max(quality.loss, quality.silence) < OUTAGE:
                carrier.on_block(now_ns + BLOCKED_NS)
                return [UseConnection(hw, link.clear(now_ns))]
        if carrier.by_datagram:
            is_full = link is not None and link.is_full
            is_used = quality.is_opening or self._kind is FrameCarrier.UDP or is_full
            carrier.end_when_clean(is_used, now_ns)
            return []
        return self._choose(hw, carrier, now_ns)

    def on_waiting(self, hw: int, now_ns: int) -> list[Action]:
        """Frames wait for the connections to a neighbour."""
        if not self.uses_datagrams(hw):
            self._checks.setdefault(hw, now_ns + CHECK_NS)
        return []

    def on_connection(
        self, hw: int, delay: ConnectionDelay | None, is_waiting: bool, now_ns: int
    ) -> list[Action]:
        """What was measured of the connections to a neighbour, and whether frames wait for them."""
        carrier = self._carrier(hw)
        size = carrier.on_connection(delay, is_waiting, now_ns)
        chosen = [] if carrier.by_datagram else self._choose(hw, carrier, now_ns)
        if is_waiting:
            self.on_waiting(hw, now_ns)
        return chosen if size is None else [SetBuffer(hw, size), *chosen]

    def _carrier(self, hw: int) -> Carrier:
        return self._carriers.setdefault(hw, Carrier())

    def _choose(self, hw: int, carrier: Carrier, now_ns: int) -> list[Action]:
        if not carrier.wants_datagrams(self._kind, now_ns):
            return []
        return self._begin_datagrams(hw, carrier)

    def _begin_datagrams(self, hw: int, carrier: Carrier) -> list[Action]:
        carrier.begin_datagrams()
        link = self._links.get(hw)
        if link is not None and carrier.queued_rtt_ns is not None:
            link.on_queue(carrier.queued_rtt_ns)
        return [UseDatagrams(hw)]

    def on_frame(self, hw: int, session: int, queued: QueuedFrame, now_ns: int) -> list[Action]:
        """A frame for a neighbour that gets datagrams, and its present session."""
        link, actions = self._current(hw, session, now_ns)
        return actions + list(link.on_frame(queued, now_ns))

    def on_packet(
        self, hw: int, session: int, data: bytes, arrived_ns: int | None, now_ns: int
    ) -> list[Action]:
        """A packet of a neighbour's session, authenticated and not a replay.

        `arrived_ns`: its arrival, if it waited for this process.
        Raises: WireError for a packet that no correct neighbour sends.
        """
        link, actions = self._current(hw, session, now_ns)
        carrier = self._carriers.get(hw)
        if (
            carrier is not None
            and not carrier.by_datagram
            and carrier.loss > CLEAN
            and self._kind is not FrameCarrier.TCP
            and now_ns >= carrier.blocked_until_ns
        ):
            actions += self._begin_datagrams(hw, carrier)  # the neighbour measures more loss
        return actions + list(link.on_packet(data, now_ns, arrived_ns))

    def _current(self, hw: int, session: int, now_ns: int) -> "tuple[ReliableLink, list[Action]]":
        """The link of a session; frames that wait for a former one begin again."""
        from swarmd.broker.core.frames.reliable.reliable_link import (
            ReliableLink,  # of links that lose packets
        )

        former = self._links.get(hw)
        if former is not None and former.session == session:
            return former, []
        quality = self._qualities.get(hw, UNKNOWN)
        carrier = self._carrier(hw)
        link = ReliableLink(hw, session, quality.rtt_ns, quality.loss, now_ns, carrier.base_ns)
        self._links[hw] = link
        if carrier.queued_rtt_ns is not None:
            link.on_queue(carrier.queued_rtt_ns)
        actions: list[Action] = []
        for queued in [] if former is None else former.clear(now_ns):
            actions += link.on_frame(queued, now_ns)
        return link, actions

    def on_timer(self, now_ns: int) -> list[Action]:
        """Everything that is due on any link."""
        actions: list[Action] = []
        for link in self._links.values():
            due_ns = link.deadline_ns()
            if due_ns is None or due_ns > now_ns:
                continue
            actions += link.on_due(now_ns)
        for hw in [hw for hw, due_ns in self._checks.items() if due_ns <= now_ns]:
            del self._checks[hw]
            actions.append(MeasureConnection(hw))
        return actions

    def deadline_ns(self) -> int | None:
        """The earliest deadline of all links."""
        instants = [link.deadline_ns() for link in self._links.values()]
        instants += self._checks.values()
        return min((one for one in instants if one is not None), default=None)

    def on_gone(self, hw: int, now_ns: int) -> list[QueuedFrame]:
        """A neighbour is lost; returns the frames that have not arrived.

        If its link lost packets, it begins with datagrams when it returns.
        """
        if not self.uses_datagrams(hw):
            self._carriers.pop(hw, None)
        self._qualities.pop(hw, None)
        self._checks.pop(hw, None)
        link = self._links.get(hw)
        return [] if link is None else link.clear(now_ns)
