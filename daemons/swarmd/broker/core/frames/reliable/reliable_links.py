"""The reliable links of a node: which neighbours get their frames in datagrams, and their sessions.

TCP recovers slowly from loss without congestion: at 30 % a connection stops for seconds. And it fills the
queue of a slow link, in which beacons and commands wait. So frames travel over TCP where a link is clean and
fast enough, and in datagrams where its beacons are lost or late, or frames wait for a queue.
"""

from typing import Final

import msgspec

from swarmd.broker.config import Config, FrameCarrier
from swarmd.broker.core.frames.carrier_choice import CLEAN, CarrierChoice, LinkQuality
from swarmd.broker.core.frames.reliable.link_action import LinkAction
from swarmd.broker.core.frames.reliable.reliable_link import ReliableLink
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.swarm.links.link import ConnectionDelay

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


class _Neighbour:
    """The choice of the carrier to one neighbour, its measurements, and the reliable link.

    This lives longer than the neighbour's record: a lossy link that returns begins with datagrams.
    """

    __slots__ = ("check_ns", "choice", "link", "quality")

    def __init__(self) -> None:
        self.choice = CarrierChoice()
        self.quality: LinkQuality | None = None
        """Last measurement by beacons, or None if the link is down or was not measured yet."""
        self.check_ns: int | None = None
        """When the connections are measured, because frames wait for them."""
        self.link: ReliableLink | None = None


class ReliableLinks:
    """Reliable links by neighbour, and the choice between them and connections."""

    def __init__(self, config: Config) -> None:
        self._kind = config.frames
        self._neighbours: dict[int, _Neighbour] = {}

    def uses_datagrams(self, hw: int) -> bool:
        """Whether frames for a neighbour travel in datagrams."""
        known = self._neighbours.get(hw)
        return known is not None and known.choice.by_datagram

    def is_clean(self, hw: int) -> bool:
        """Whether frames for a neighbour travel over a connection of whose beacons nearly none is lost or
        late."""
        known = self._neighbours.get(hw)
        if known is None or known.quality is None:
            return False
        return self._kind is FrameCarrier.AUTO and known.choice.is_clean

    def link(self, hw: int) -> ReliableLink | None:
        """The reliable link of a neighbour, if there is one."""
        known = self._neighbours.get(hw)
        return None if known is None else known.link

    def links(self) -> "list[ReliableLink]":
        """The reliable links to all neighbours."""
        return [known.link for known in self._neighbours.values() if known.link is not None]

    def on_quality(self, hw: int, quality: LinkQuality, now_ns: int) -> list[Action]:
        """Takes the measurement of a link by beacons, once a second while it is up."""
        known = self._known(hw)
        known.quality = quality
        choice, link = known.choice, known.link
        choice.on_quality(quality)
        if link is not None:
            link.rate.on_link_loss(choice.loss)
            # beacons arrive while datagrams with frames do not; a firewall, not the radio
            if link.is_blocked and max(quality.loss, quality.silence) < OUTAGE:
                choice.on_block(now_ns + BLOCKED_NS)
                return [UseConnection(hw, link.clear(now_ns))]
        if choice.by_datagram:
            # a link that is slower than its frames would fill the queue of a connection again
            is_full = link is not None and link.is_full
            is_used = quality.is_opening or self._kind is FrameCarrier.UDP or is_full
            choice.end_when_clean(is_used, now_ns)
            return []
        return self._choose(hw, known, now_ns)

    def on_waiting(self, hw: int, now_ns: int) -> list[Action]:
        """Frames wait for the connections to a neighbour."""
        known = self._known(hw)
        if not known.choice.by_datagram and known.check_ns is None:
            known.check_ns = now_ns + CHECK_NS
        return []

    def on_connection(
        self, hw: int, delay: ConnectionDelay | None, is_waiting: bool, now_ns: int
    ) -> list[Action]:
        """Takes a measurement of the connections to a neighbour, and whether frames wait for them."""
        known = self._known(hw)
        size = known.choice.on_connection(delay, is_waiting, now_ns)
        chosen = [] if known.choice.by_datagram else self._choose(hw, known, now_ns)
        if is_waiting:
            self.on_waiting(hw, now_ns)
        return chosen if size is None else [SetBuffer(hw, size), *chosen]

    def _known(self, hw: int) -> _Neighbour:
        known = self._neighbours.get(hw)
        if known is None:
            known = self._neighbours[hw] = _Neighbour()
        return known

    def _choose(self, hw: int, known: _Neighbour, now_ns: int) -> list[Action]:
        if not known.choice.wants_datagrams(self._kind, now_ns):
            return []
        return self._begin_datagrams(hw, known)

    def _begin_datagrams(self, hw: int, known: _Neighbour) -> list[Action]:
        choice, link = known.choice, known.link
        choice.begin_datagrams()
        if link is not None and choice.queued_rtt_ns is not None:
            link.on_queue(choice.queued_rtt_ns)
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
        known = self._neighbours[hw]
        choice = known.choice
        if (
            not choice.by_datagram
            and choice.loss > CLEAN
            and self._kind is not FrameCarrier.TCP
            and now_ns >= choice.blocked_until_ns
        ):
            actions += self._begin_datagrams(hw, known)  # the neighbour measures more loss
        return actions + list(link.on_packet(data, now_ns, arrived_ns))

    def _current(self, hw: int, session: int, now_ns: int) -> tuple[ReliableLink, list[Action]]:
        """The link of a session; frames that wait for a former one begin again."""
        known = self._known(hw)
        former, choice = known.link, known.choice
        if former is not None and former.session == session:
            return former, []
        # begins with what the beacons have measured, in place of a slow start
        quality = known.quality or UNKNOWN
        link = ReliableLink(hw, session, quality.rtt_ns, quality.loss, now_ns, choice.base_ns)
        known.link = link
        if choice.queued_rtt_ns is not None:
            link.on_queue(choice.queued_rtt_ns)
        actions: list[Action] = []
        for queued in [] if former is None else former.clear(now_ns):
            actions += link.on_frame(queued, now_ns)
        return link, actions

    def on_timer(self, now_ns: int) -> list[Action]:
        """Everything that is due on any link."""
        actions: list[Action] = []
        for hw, known in self._neighbours.items():
            if known.link is not None:
                due_ns = known.link.deadline_ns()
                if due_ns is not None and due_ns <= now_ns:
                    actions += known.link.on_due(now_ns)
            if known.check_ns is not None and known.check_ns <= now_ns:
                known.check_ns = None
                actions.append(MeasureConnection(hw))
        return actions

    def deadline_ns(self) -> int | None:
        """The earliest deadline of all links."""
        instants = [link.deadline_ns() for link in self.links()]
        instants += [known.check_ns for known in self._neighbours.values()]
        return min((one for one in instants if one is not None), default=None)

    def on_gone(self, hw: int, now_ns: int) -> list[QueuedFrame]:
        """A neighbour is lost; returns the frames that have not arrived.

        If its link lost packets, it begins with datagrams when it returns.
        """
        known = self._neighbours.pop(hw, None)
        if known is None:
            return []
        if known.choice.by_datagram or known.link is not None:
            kept = self._neighbours[hw] = _Neighbour()
            kept.link = known.link
            if known.choice.by_datagram:
                kept.choice = known.choice
        return [] if known.link is None else known.link.clear(now_ns)
