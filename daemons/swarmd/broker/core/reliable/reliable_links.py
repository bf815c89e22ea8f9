"""The reliable links of a node: which neighbours get their frames in datagrams, and their sessions.

TCP recovers slowly from loss without congestion: at 30 % a connection stops for seconds. And it fills the
queue of a slow link, in which beacons and commands wait. So frames travel over TCP where a link is clean and
fast enough, and in datagrams where its beacons are lost or late.
"""

from typing import TYPE_CHECKING, Final

import msgspec

from swarmd.broker.config import Config, FrameCarrier
from swarmd.broker.core.forwarding.send_queue import QueuedFrame
from swarmd.broker.core.reliable.link_action import LinkAction

if TYPE_CHECKING:
    from swarmd.broker.core.reliable.reliable_link import ReliableLink

LOSSY: Final = 0.05
"""Smoothed loss of the beacons from which on frames travel in datagrams."""
CLEAN: Final = 0.01
"""Smoothed loss below which they travel over TCP again, after `CLEAN_NS`."""
CLEAN_NS: Final = 20_000_000_000
QUEUE_NS: Final = 60_000_000
"""Round trip of the beacons above its minimum that shows a queue, in `QUEUED` seconds in a row: twice what
the window of a reliable link fills."""
QUEUED: Final = 2
BASE_RISE: Final = 64
"""Part of its excess by which the minimum of the round trip follows each second: delays may have grown."""
WEIGHT: Final = 0.4
"""Weight of the newest second's loss: at 30 % the first second is enough, a single loss is not."""
OUTAGE: Final = 0.7
"""Loss of the last beacons from which on the link itself, not a firewall, stops the datagrams."""
BLOCKED_NS: Final = 60_000_000_000
"""Time after which a neighbour that did not acknowledge datagrams gets them again."""


class LinkQuality(msgspec.Struct, frozen=True):
    """What beacons measured of the link to a neighbour."""

    loss: float
    """Loss of the worse direction."""
    rtt_ns: int = 0
    """0: not measured."""


UNKNOWN: Final = LinkQuality(0.0)


class UseConnection(msgspec.Struct, frozen=True):
    """Action: send these frames over the connection; the neighbour does not get the datagrams."""

    hw: int
    frames: list[QueuedFrame]


class UseDatagrams(msgspec.Struct, frozen=True):
    """Action: pass the frames that wait for the connection to a neighbour to its reliable link."""

    hw: int


Action = LinkAction | UseConnection | UseDatagrams


class _Choice(msgspec.Struct):
    loss: float = 0.0
    """Smoothed."""
    base_ns: int | None = None
    """Minimum of the round trip."""
    queued: int = 0
    """Seconds in a row with a queue."""
    by_datagram: bool = False
    clean_since_ns: int | None = None
    blocked_until_ns: int = 0

    def on_round_trip(self, rtt_ns: int) -> None:
        """The smoothed round trip of the last beacons; 0: not measured."""
        if not rtt_ns:
            return
        base_ns = self.base_ns
        if base_ns is None or rtt_ns <= base_ns:
            self.base_ns = rtt_ns
        elif not self.by_datagram:
            self.base_ns = base_ns + (rtt_ns - base_ns) // BASE_RISE
        self.queued = self.queued + 1 if rtt_ns - (self.base_ns or 0) > QUEUE_NS else 0


class ReliableLinks:
    """Reliable links by neighbour, and the choice between them and connections."""

    def __init__(self, config: Config) -> None:
        self._carrier = config.frames
        self._links: dict[int, ReliableLink] = {}
        self._choices: dict[int, _Choice] = {}
        self._qualities: dict[int, LinkQuality] = {}

    def uses_datagrams(self, hw: int) -> bool:
        """Whether frames for a neighbour travel in datagrams."""
        choice = self._choices.get(hw)
        return choice is not None and choice.by_datagram

    def is_clean(self, hw: int) -> bool:
        """Whether frames for a neighbour travel over a connection of whose beacons nearly none is lost or
        late."""
        choice = self._choices.get(hw)
        return (
            choice is not None
            and self._carrier is FrameCarrier.AUTO
            and not choice.by_datagram
            and choice.loss <= CLEAN
            and not choice.queued
        )

    def link(self, hw: int) -> "ReliableLink | None":
        """The reliable link of a neighbour, if there is one."""
        return self._links.get(hw)

    def links(self) -> "list[ReliableLink]":
        """The reliable links to all neighbours."""
        return list(self._links.values())

    def on_quality(self, hw: int, quality: LinkQuality, now_ns: int) -> list[Action]:
        """What beacons measure of the link to a neighbour, once a second while it is up."""
        self._qualities[hw] = quality
        choice = self._choices.setdefault(hw, _Choice())
        choice.loss += WEIGHT * (quality.loss - choice.loss)
        choice.on_round_trip(quality.rtt_ns)
        link = self._links.get(hw)
        if link is not None:
            link.rate.on_link_loss(choice.loss)
            if link.is_blocked and quality.loss < OUTAGE:
                choice.by_datagram, choice.blocked_until_ns = False, now_ns + BLOCKED_NS
                return [UseConnection(hw, link.clear(now_ns))]
        if choice.by_datagram:
            if (
                choice.loss > CLEAN
                or self._carrier is FrameCarrier.UDP
                or (link is not None and link.is_full)
            ):
                choice.clean_since_ns = None
            elif choice.clean_since_ns is None:
                choice.clean_since_ns = now_ns
            elif now_ns - choice.clean_since_ns >= CLEAN_NS:
                choice.by_datagram = False
            return []
        if choice.loss < LOSSY and choice.queued < QUEUED and self._carrier is not FrameCarrier.UDP:
            return []
        return self._choose_datagrams(hw, choice, now_ns)

    def _choose_datagrams(self, hw: int, choice: _Choice, now_ns: int) -> list[Action]:
        if self._carrier is FrameCarrier.TCP or now_ns < choice.blocked_until_ns:
            return []
        choice.by_datagram, choice.clean_since_ns, choice.queued = True, None, 0
        return [UseDatagrams(hw)]

    def on_frame(self, hw: int, session: int, queued: QueuedFrame, now_ns: int) -> list[Action]:
        """A frame for a neighbour that gets datagrams, and its present session."""
        link, actions = self._current(hw, session, now_ns)
        return actions + list(link.on_frame(queued, now_ns))

    def on_packet(self, hw: int, session: int, data: bytes, now_ns: int) -> list[Action]:
        """A packet of a neighbour's session, authenticated and not a replay.

        Raises: WireError for a packet that no correct neighbour sends.
        """
        link, actions = self._current(hw, session, now_ns)
        choice = self._choices.get(hw)
        if choice is not None and not choice.by_datagram and choice.loss > CLEAN:
            actions += self._choose_datagrams(hw, choice, now_ns)  # the neighbour measures more loss
        return actions + list(link.on_packet(data, now_ns))

    def _current(self, hw: int, session: int, now_ns: int) -> "tuple[ReliableLink, list[Action]]":
        """The link of a session; frames that wait for a former one begin again."""
        from swarmd.broker.core.reliable.reliable_link import ReliableLink  # of links that lose packets

        former = self._links.get(hw)
        if former is not None and former.session == session:
            return former, []
        quality = self._qualities.get(hw, UNKNOWN)
        choice = self._choices.get(hw)
        base_ns = None if choice is None else choice.base_ns
        link = self._links[hw] = ReliableLink(hw, session, quality.rtt_ns, quality.loss, now_ns, base_ns)
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
        return actions

    def deadline_ns(self) -> int | None:
        """The earliest deadline of all links."""
        instants = [link.deadline_ns() for link in self._links.values()]
        return min((one for one in instants if one is not None), default=None)

    def on_gone(self, hw: int, now_ns: int) -> list[QueuedFrame]:
        """A neighbour is lost; returns the frames that have not arrived.

        If its link lost packets, it begins with datagrams when it returns.
        """
        if not self.uses_datagrams(hw):
            self._choices.pop(hw, None)
        self._qualities.pop(hw, None)
        link = self._links.get(hw)
        return [] if link is None else link.clear(now_ns)
