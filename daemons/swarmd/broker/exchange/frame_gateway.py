"""Routes frames between platforms: from local applications to neighbours, and from neighbours onward."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from swarmd.broker.config import Config
from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.frames.end_to_end import EndToEnd
from swarmd.broker.core.frames.forwarder import ForwardDecision, ForwardStep
from swarmd.broker.core.frames.send_queue import QueuedFrame
from swarmd.broker.core.frames.waiting_answers import WaitingAnswers
from swarmd.broker.core.membership.roster.roster_exchange import RosterAction, SendRoster
from swarmd.broker.core.swarm.neighbour import LinkPeer
from swarmd.broker.core.traffic import FrameAccounts
from swarmd.broker.exchange.carriers.frame_datagrams import NeighbourMedia
from swarmd.broker.exchange.frame_delivery import FrameDelivery
from swarmd.broker.exchange.frame_links import FrameLinks
from swarmd.broker.exchange.unit_delay import UnitDelays
from swarmd.broker.sockets.pair_seal import PairEnd
from swarmware.errors import ConfigError, Denied, WireError
from swarmware.model.frame import HOPS, Flag, Frame, FrameKind
from swarmware.model.names import hardware_id
from swarmware.node.node import Node
from swarmware.transport.delivery.answer import answerable
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.signature import with_node
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.roster import RosterChange

FORWARD: Final = "forward"
"""Verb of a denial: the platform forwarded a frame that its sender did not sign, or not recently."""
CONNECT: Final = "connect"
"""Verb of a denial: a connection with a key that is not on the roster."""
VISIT_NS: Final = 3_000_000_000
"""Time for the messages about the roster with a node that is not a neighbour."""

log = logging.getLogger("swarm.broker")


class FrameGateway:
    """The gateway of this node's message router to other platforms."""

    def __init__(
        self,
        config: Config,
        keys: Keys,
        node: Node,
        core: BrokerCore,
        ways: NeighbourMedia | None,
        denials: DenialReporter,
        on_roster_actions: Callable[[list[RosterAction]], None],
    ) -> None:
        """Raises: ConfigError when the port cannot be bound."""
        self._on_roster_actions = on_roster_actions
        self._keys = keys
        self._clock = node.clock
        self._messaging = node.messaging
        self._core = core
        self._counters = core.counters
        self._accounts = FrameAccounts(core.counters, node.table)
        self._delivery = FrameDelivery(
            keys,
            node.messaging,
            node.table,
            core,
            self._accounts,
            node.access_rules.access,
            denials,
            _unit_delay(config),
        )
        self._forwarder = core.forwarder
        self._end_to_end = EndToEnd(
            core.identity.hw, core.session, keys, core.nodes.platform, core.counters.refused
        )
        self._answers = WaitingAnswers()
        self._visits: dict[int, int] = {}
        """Nodes that are not neighbours and got the roster, and when their connection is closed."""
        self.links = FrameLinks(
            config,
            keys,
            PairEnd(core.identity.hw, core.session, keys.curve_public),
            node.clock,
            core.counters,
            ways,
            self,
        )

    def from_here(self, frame: Frame, data: bytes | None = None) -> None:
        """Takes a frame of a local application for another platform; called by the message router.

        `data`: the frame as another process encoded it.
        """
        decision = self._forwarder.from_here(frame, self._clock.now_ns())
        self._onward(frame, decision, data)
        self._accounts.offered(frame, first=decision.first)  # counted when it was sent

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Context manager: queues frames for other platforms and sends them together when it ends."""
        with self.links.batch():
            yield

    def prepare(self, hw: int) -> None:
        """Makes the keys for datagrams to a neighbour that has introduced itself."""
        peer = self.find_peer(hw)
        if peer is not None:
            self.links.prepare(peer)

    def prove(self, hw: int, session: int) -> None:
        """Sends a neighbour the own session over a connection that only the own key opens."""
        peer = self.find_peer(hw)
        if peer is not None and peer.host:
            own_hw = self._core.identity.hw
            payload = session.to_bytes(8, "little")
            self.links.send(
                peer, Frame(FrameKind.HELLO, 0, own_hw, 0, hw, 0, flags=Flag.URGENT, payload=payload)
            )

    def on_proof(self, frame: Frame, user: str) -> None:
        """Takes the session of a neighbour from a connection that only the key of its platform opens."""
        if not user or frame.hops_left != HOPS or self._other_end(frame, user) != frame.sender_hw:
            self._counters.refused.spoofed += 1
        elif len(frame.payload) == 8:
            session = int.from_bytes(frame.payload, "little")
            self._core.on_proof(frame.sender_hw, session, self._clock.now_ns())

    def neighbour_gone(self, hw: int) -> None:
        """Sends the frames queued for a lost neighbour over another one, or refuses them."""
        if hw in self._visits:
            return
        for item in self.links.disconnect(hw):
            decision = self._forwarder.reroute(item.frame, self._clock.now_ns())
            relayed = item.frame.sender_hw != self._core.identity.hw
            self._onward(item.frame, decision, item.data, rerouted=True, relayed=relayed)

    def on_routes(self) -> None:
        """Sends the answers that have a route now."""
        if not self._answers:
            return
        now_ns = self._clock.now_ns()
        for item in self._answers.take(self._forwarder.has_route, now_ns):
            decision = self._forwarder.reroute(item.frame, now_ns)
            self._onward(item.frame, decision, None, relayed=item.relayed)

    # the roster

    def send_roster(self, message: SendRoster) -> None:
        """Sends a message about the roster to a neighbour, or to another node whose address is known."""
        hw, target = message.hw, self._core.targets.find(message.hw)
        curve = message.curve_public or self._keys.curve_of(message.platform)
        if not curve:
            return
        if message.curve_public:
            self.neighbour_gone(hw)  # the frames that wait for a revoked node are refused
        peer = None if message.curve_public or not self._core.is_up(hw) else self.find_peer(hw)
        if peer is None:
            host = message.host or (target.host if target is not None else "")
            port = message.port or (target.port if target is not None else 0)
            if not host or not port:
                return
            peer = LinkPeer(hw, message.platform, host, port, curve, 0)
            self._visits[hw] = self._clock.now_ns() + VISIT_NS
        own_hw = self._core.identity.hw
        self.links.send(
            peer, Frame(FrameKind.ROSTER, 0, own_hw, 0, hw, 0, flags=Flag.URGENT, payload=message.payload)
        )

    def on_roster_frame(self, frame: Frame, user: str, host: str) -> None:
        """Takes a message about the roster, and the platform and address of its sender."""
        refused, exchange = self._counters.refused, self._core.exchange
        hw = frame.sender_hw
        if not user or exchange is None or frame.hops_left != HOPS or self._other_end(frame, user) != hw:
            refused.spoofed += 1
            return
        try:
            found = exchange.on_message(hw, user, frame.payload, host, self._clock.now_ns())
        except WireError as error:
            refused.malformed += 1
            log.debug("message about the roster from %s: %s", user, error)
        except (ConfigError, Denied) as error:
            refused.rosters += 1
            log.warning("roster from %s refused: %s", user, error)
        else:
            self._on_roster_actions(found)

    def take_roster(self, text: bytes) -> None:
        """Takes the roster of an operator. Raises: ConfigError, Denied."""
        if self._core.exchange is not None:
            self._on_roster_actions(self._core.exchange.on_text(text, self._clock.now_ns()))

    def on_roster(self, change: RosterChange) -> None:
        """The keys have another roster: roles, members, and connections of those who left."""
        self._delivery.set_roles(change.roster.roles())
        gone = {member.platform for member in change.gone}
        for peer in self.links.connected():
            if peer.platform in gone:
                self.neighbour_gone(peer.hw)
        self.links.on_roster()

    def end_visits(self) -> None:
        """Closes the connections to nodes that got the roster and did not become neighbours."""
        now_ns = self._clock.now_ns()
        for hw in [hw for hw, end_ns in self._visits.items() if now_ns >= end_ns]:
            del self._visits[hw]
            if not self._core.is_up(hw):
                self.neighbour_gone(hw)

    def excludes(self, hw: int) -> bool:
        """Whether the roster excludes this node."""
        exchange = self._core.exchange
        return exchange is not None and exchange.excludes(hw)

    def on_frame(self, frame: Frame, user: str, now_ns: int) -> None:
        """Delivers or forwards a frame; `user`: the member that sent it, or "" without authentication."""
        counters = self._counters
        if self.excludes(frame.sender_hw):
            counters.refused.revoked += 1  # another member forwarded it
            return
        other_hw = self._other_end(frame, user)
        decision = self._forwarder.from_neighbour(frame, other_hw, now_ns)
        if decision.step is ForwardStep.DELIVER:
            incoming = self._end_to_end.on_frame(frame, other_hw, decision.first, now_ns)
            for own in incoming.outgoing:
                self._onward(own, self._forwarder.from_here(own, now_ns), None)
            for arrival in incoming.arrivals:
                self._delivery.on_arrival(arrival)
            if incoming.refusal:
                path = self._delivery.path_of(frame.data_id) or ""
                self._delivery.report_denial(user or "?", FORWARD, path, incoming.refusal, now_ns)
            return
        if decision.step is ForwardStep.SEND:
            if self._messaging.expired(frame):
                counters.refused.expired += 1  # a refusal was sent to its sender
                return
            counters.forwarded_frames += 1
            frame.extension = with_node(frame.extension, self._core.identity.hw)
        self._onward(frame, decision, None, relayed=True)

    def on_unknown_key(self, name: str, reason: str) -> None:
        """Reports a denied handshake."""
        self._delivery.report_denial(name, CONNECT, "", reason, self._clock.now_ns())

    def _other_end(self, frame: Frame, user: str) -> int | None:
        """Hardware id of the member at the other end of a connection, or None without authentication."""
        if not user:
            return None
        member = self._core.nodes.get(frame.sender_hw)
        return frame.sender_hw if member is not None and member.platform == user else hardware_id(user)

    def _onward(
        self,
        frame: Frame,
        decision: ForwardDecision,
        data: bytes | None,
        *,
        rerouted: bool = False,
        relayed: bool = False,
    ) -> None:
        """`data`: the frame as it was encoded, unless it has changed since; `relayed`: of another node."""
        if decision.step is ForwardStep.SEND:
            peer = self.find_peer(decision.via)
            if peer is not None:
                signed = frame if relayed else self._signed(frame, decision.via)
                if signed is None:
                    return
                if signed is not frame:
                    frame, data = signed, None
                if rerouted:
                    self.links.send(peer, frame, data)
                else:
                    self.links.begin(peer, frame, data, is_first=decision.first)
                return
        refused = self._counters.refused
        receiver = self._core.nodes.platform(frame.receiver_hw)
        if decision.step is ForwardStep.LOOPED:
            refused.looped += 1
        elif decision.step is ForwardStep.SPOOFED:
            refused.spoofed += 1
            log.warning("frame with sender %08x came from another member", frame.sender_hw)
        elif decision.step is ForwardStep.HOP_LIMIT:
            refused.hop_limit += 1
            self._refuse(frame, f"too many hops to {receiver}")
        elif not self._answers.hold(frame, relayed, self._clock.now_ns()):
            refused.no_route += 1
            self._refuse(frame, f"no route to {receiver}")

    def _signed(self, frame: Frame, via: int) -> Frame | None:
        try:
            return self._end_to_end.signed(frame, via)
        except WireError as error:
            self._counters.refused.malformed += 1
            self._refuse(frame, str(error))
            return None

    def on_sent(self, frame: Frame) -> None:
        """Counts a frame that is sent to a neighbour; queued and rerouted frames are not counted."""
        self._counters.sent_frames += 1
        for channel, payload_bytes in self._accounts.channels(frame):
            channel.sent(payload_bytes)

    def find_peer(self, hw: int) -> LinkPeer | None:
        """Endpoint and keys of a neighbour, or None for any other node."""
        peer = self._core.targets.find(hw)
        # a node that is not on the roster has the group key at most: no key for connections is known
        return peer if peer is not None and peer.curve_public else None

    def update_counters(self) -> None:
        """Brings the traffic counters of the connections up to date."""
        self.links.update_counters()

    def on_given_up(self, peer: LinkPeer, frames: list[QueuedFrame]) -> None:
        """Refuses the frames that could not be brought to a neighbour."""
        for item in frames:
            self.on_dropped(item.frame)
            self._refuse(item.frame, f"{peer.platform} does not take it")

    def on_dropped(self, frame: Frame) -> None:
        """Counts a frame that could not be sent in its channels."""
        for channel, _ in self._accounts.channels(frame):
            channel.dropped += 1

    def _refuse(self, frame: Frame, detail: str) -> None:
        if answerable(frame):
            self._messaging.refuse(frame, Status.UNREACHABLE, detail)

    def close(self) -> None:
        """Close all connections to neighbours."""
        self._delivery.close()
        self.links.close()


def _unit_delay(config: Config) -> UnitDelays | None:
    if not config.unit_delay_ms:
        return None
    return UnitDelays(*config.unit_delay_ms)
