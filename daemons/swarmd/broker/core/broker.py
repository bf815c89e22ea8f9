"""The broker's core: beacons, sessions, rate limits and tables of one node."""

from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.broker.config import MAIN, Config
from swarmd.broker.core.beacon.beacon import Beacon, Header, OutgoingBeacon
from swarmd.broker.core.beacon.beacon_rate import BeaconSchedule, ReportSlowdown
from swarmd.broker.core.beacon.declared_period import DeclaredPeriod, RestartState
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon.parts import session_checks
from swarmd.broker.core.beacon.parts.beacon_signature import PART_BYTES
from swarmd.broker.core.beacon_protocol import SETTLE_NS, BeaconProtocol
from swarmd.broker.core.boards.board_action import (
    KeepMirrors,
    LimitEnded,
    ReportUnsignedValues,
    WriteMirrors,
    WriteStructure,
)
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.frames.forwarder import FrameForwarder
from swarmd.broker.core.membership.origins import RATE_DIVISOR
from swarmd.broker.core.membership.other_swarms import OtherSwarms
from swarmd.broker.core.membership.roster.roster_exchange import (
    ApplyRoster,
    RosterAction,
    SendRoster,
)
from swarmd.broker.core.membership.sessions import (
    ACCEPTED,
    AdoptSession,
    ProveSession,
    ReportDuplicate,
    ReportDuplicateGone,
    ReportImpersonation,
    SessionOutcome,
    Sessions,
    SwarmMembership,
)
from swarmd.broker.core.membership.signatures.own_signatures import OwnSignatures
from swarmd.broker.core.membership.signatures.signature_checks import CheckedDatagram, SignatureFault
from swarmd.broker.core.reports.report import NetReport, PublishTables
from swarmd.broker.core.swarm.clock_batches import ClockBatches, WriteClockSamples
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkEvent, LinkState
from swarmd.broker.core.swarm.neighbours.link_targets import LinkTargets
from swarmd.broker.core.swarm.neighbours.medium_table import (
    ByMedium,
    MediumChanged,
    MediumTable,
    connection_host,
    media_of,
    transport_of,
)
from swarmd.broker.core.swarm.routes.routing_table import RouteChanged
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.runtime.core import AT_ONCE
from swarmware.transport.security.roster import RosterChange
from swarmware.types.net import UNACCEPTED, TreePlan

DUPLICATE_NS: Final = 5_000_000_000
"""A duplicate of a platform name is cleared after this time without a datagram of the second computer."""
PUBLISH_NS: Final = 1_000_000_000
"""Period of the tables of neighbours, routes and traffic."""
_SEQUENCE_NS: Final = 100_000_000
"""Sequence numbers start at the wall clock in beacons of 10 Hz: above all numbers of a former session."""

Address = tuple[str, int]


Action = (
    WriteMirrors
    | WriteStructure
    | KeepMirrors
    | PublishTables
    | LimitEnded
    | WriteClockSamples
    | AdoptSession
    | ProveSession
    | ReportDuplicate
    | ReportDuplicateGone
    | ReportSlowdown
    | ReportUnsignedValues
    | ReportImpersonation
    | LinkChanged
    | MediumChanged
    | SendRoster
    | ApplyRoster
)


class BrokerCore:
    """Decides when beacons are sent, which sessions are accepted, and what is reported."""

    def __init__(
        self,
        identity: NodeIdentity,
        config: Config,
        session: int,
        *,
        former: RestartState,
        now_ns: int,
        chance: Callable[[], float],
        membership: SwarmMembership = SwarmMembership(),  # noqa: B008  # immutable
        channels: ChannelTable | None = None,
    ) -> None:
        """`channels`: the rules of the file, or None if it has none.

        `chance`: uniform from 0 to 1, for the jitter of beacons.
        """
        exchange, signing, connections, curve_of = membership
        self.identity = identity
        self.counters = Counters()
        topology = Topology(
            identity.hw,
            session // _SEQUENCE_NS & 0x7FFF_FFFF,
            round(config.link_timeout_s * 1e9),
            now_ns + former.quiet_ns,
        )
        self._neighbours = topology.neighbours
        self.media = media_of(identity.hw, config, topology.neighbours)
        """The media, or None on a node with one network."""
        self._protocol = protocol = BeaconProtocol(
            identity,
            topology,
            self.counters,
            config,
            declared_period=DeclaredPeriod(former.declared_period_ns, now_ns),
            media=self.media,
            channels=channels,
            signing=signing,
        )
        self.exchange = exchange
        if exchange is not None:
            protocol.hellos.set_roster_version(exchange.version)
        self.nodes = protocol.nodes
        self.published = protocol.published
        self.channels = protocol.channels
        self.forwarder = FrameForwarder(identity.hw, topology.routing)
        self.targets = LinkTargets(
            topology.neighbours, protocol.nodes, None if self.media is None else connection_host, curve_of
        )
        self.other_swarms = OtherSwarms(session)
        self.report = NetReport(protocol, topology, self.counters, self.other_swarms, now_ns)
        self.session = session
        self._sessions = Sessions(identity.hw, session, connections=connections)
        self.signatures = None if signing is None else OwnSignatures(identity.hw, session, signing)
        self._schedule = BeaconSchedule(now_ns, chance)
        self._publish_ns = now_ns
        self._tables_changed = False
        self._triggered = False
        """A beacon is to be triggered. Its jitter counts from the next step, because many nodes read their
        datagrams in batches at the same instants."""
        self._boards_read = False
        self.beacon_due = False
        """A beacon is to be composed and sent now: `on_timer` has decided that, and `compose` resets it."""
        self._links_ns: int | None = None
        """Deadline of the links when the inputs were read last; datagrams only move it later."""
        self._duplicate_ns = 0
        self._clock_samples = ClockBatches(self.nodes, now_ns)

    def add_members(self, platforms: Iterable[str], now_ns: int) -> None:
        """Takes the platforms on the roster: their names are known before they are received."""
        for platform in platforms:
            self.nodes.add(platform, now_ns)

    def set_ports(self, tcp_port: int, frame_port: int) -> None:
        """Sets the ports that hellos announce: of connections, and of frames as datagrams."""
        self._protocol.hellos.tcp_port = tcp_port
        self._protocol.hellos.frame_port = frame_port
        if self.exchange is not None:
            self.exchange.port = tcp_port

    # time

    def deadline_ns(self) -> int | None:
        """Instant of the next beacon, of the next tables, or of a silent link."""
        # handled in a step of their own, after all waiting datagrams
        if self._tables_changed or self._triggered:
            return AT_ONCE
        due_ns = min(self._schedule.due_ns, self._publish_ns, self._neighbours.again_ns)
        if self._links_ns is not None and self._links_ns < due_ns:
            due_ns = self._links_ns
        asked_ns = None if self.exchange is None else self.exchange.deadline_ns()
        return due_ns if asked_ns is None or asked_ns > due_ns else asked_ns

    def begin_turn(self, now_ns: int) -> bool:
        """Takes the lateness of a timer; True if the boards are to be read before `on_timer`, for a beacon.

        The waiting datagrams are received before `on_timer`, too, which judges the silence of their senders.
        """
        self._protocol.delay.on_turn(self.deadline_ns(), now_ns)
        self._boards_read = now_ns >= self._schedule.due_ns
        return self._boards_read

    def on_timer(self, now_ns: int) -> list[Action]:
        """Handles expired deadlines: silent links, expired routes and limits, the next beacon, the tables."""
        protocol, actions = self._protocol, list[Action]()
        limits = protocol.channels
        version = limits.version
        if self.media is not None:
            self._choose_media(self.media, actions, now_ns)
        self._on_changes(*protocol.advance(now_ns), actions, now_ns)
        if limits.version != version:
            actions.append(LimitEnded())
        if self._neighbours.take_asking() or self._triggered:
            self._triggered = False
            self._schedule.trigger(now_ns, round(1e9 / protocol.allowed_hz()))
        # a beacon that became due while datagrams were received would lack the newest values of the boards
        if self._boards_read and now_ns >= self._schedule.due_ns:
            self._boards_read = False
            self._on_beacon_due(actions, now_ns)
        if self._tables_changed or now_ns >= self._publish_ns:
            self._publish(actions, now_ns)
        if self.exchange is not None:
            actions += self.exchange.advance(now_ns)
        self._links_ns = protocol.deadline_ns()
        if self.media is not None and (silent_ns := self.media.deadline_ns(now_ns)) is not None:
            self._links_ns = silent_ns if self._links_ns is None else min(self._links_ns, silent_ns)
        return actions

    def _choose_media(self, media: MediumTable, actions: list[Action], now_ns: int) -> None:
        for hw in media.advance(now_ns):
            self._tables_changed = True
            actions.append(MediumChanged(hw))

    def _on_beacon_due(self, actions: list[Action], now_ns: int) -> None:
        schedule, slowdown = self._schedule, self._protocol.slowdown
        if slowdown.on_beacon(now_ns - schedule.due_ns, self._period_ns()):
            actions.append(ReportSlowdown(slowdown.factor, slowdown.late_ns))
        batch = self._clock_samples.due(self._protocol.topology.is_changing(now_ns, SETTLE_NS), now_ns)
        if batch is not None:
            actions.append(WriteClockSamples(batch))
        period_ns = self._period_ns()
        # questions and answers of sessions must not wait; links come up only after them
        urgent = schedule.urgent or self._sessions.waiting > 0
        if not urgent and self._protocol.may_skip(now_ns + schedule.jitter_ns(period_ns)):
            schedule.skip(now_ns, period_ns)
        elif urgent or not schedule.defer_after_skip(now_ns, period_ns):
            schedule.on_sent(now_ns)
            self.beacon_due = True

    def _publish(self, actions: list[Action], now_ns: int) -> None:
        is_period = now_ns >= self._publish_ns
        if is_period:
            # at whole seconds, together with the other periodic work of the node
            self._publish_ns = (now_ns // PUBLISH_NS + 1) * PUBLISH_NS
        if self._duplicate_ns and now_ns - self._duplicate_ns > DUPLICATE_NS:
            self._duplicate_ns = 0
            actions.append(ReportDuplicateGone())
        self._tables_changed = False
        actions.append(PublishTables(is_period))

    def _period_ns(self) -> int:
        return round(1e9 / self._protocol.beacon_hz())

    # datagrams

    def on_datagram(
        self,
        header: Header,
        beacon: Beacon,
        address: Address,
        by_multicast: bool,
        size: int,
        checked: CheckedDatagram,
        by: ByMedium | None,
        now_ns: int,
    ) -> tuple[bool, list[Action]]:
        """Takes a beacon with a valid seal, whose header names its session; returns whether it is accepted.

        `by`: how it came, or None on a node with one network.
        """
        hw, actions = header.sender_hw, list[Action]()
        assert header.session is not None, "the session is known from the key that opened the datagram"
        if checked.fault is SignatureFault.FALSE:
            # a node with another key may ask, so that it learns that it is received and refused
            is_other_key = beacon.signature is not None and self._sessions.present(hw) != header.session
            actions.append(ReportImpersonation(hw, checked.host, is_other_key))
            if not is_other_key:
                self.counters.refused.unsigned += 1
                self.counters.refused.impersonated += 1
                self.counters.datagram_received(size, UNACCEPTED, transport_of(by))
                return False, actions
        media = self.media if checked.is_genuine else None
        if media is not None and by is not None and media.is_copy(header, by):
            return self._on_copy(media, header, address, size, now_ns, by), actions
        is_main = by is None or by.medium.name == MAIN
        outcome = self._sessions.on_datagram(
            hw,
            header.session,
            beacon.checks,
            now_ns,
            is_proven=checked.is_genuine,
            by_network=by is None or by.medium.has_connections,
        )
        if outcome is not ACCEPTED:
            self._on_outcome(hw, header.session, outcome, actions, now_ns)
        # nothing but its session checks counts, which were taken above
        if not outcome.accepted or not checked.is_genuine:
            self.counters.datagram_received(size, UNACCEPTED, transport_of(by))
            if outcome.accepted:
                self.counters.refused.unproven += 1
            elif is_main and not by_multicast:
                self.targets.on_claimant(address, now_ns)
            return False, actions
        if self.exchange is not None:
            if (hello := beacon.hello) is not None and self.exchange.excludes_name(hw, hello.name):
                self.counters.refused.revoked += 1
                return False, actions
            beacon = self.exchange.without_excluded(beacon)
        if self.media is not None and by is not None:
            main_address = self.media.address_on_main(header, by, address)
        else:
            main_address = address
        received = self._protocol.on_beacon(header, beacon, main_address, now_ns, checked.proof)
        if received is None:
            self.counters.datagram_received(size, UNACCEPTED, transport_of(by))
            return True, actions
        self.counters.datagram_received(size, self.nodes.platform(hw), transport_of(by))
        if self.exchange is not None and beacon.hello is not None:
            self.exchange.on_shown(hw, self.nodes.platform(hw), beacon.hello.roster_version, now_ns)
        if self.media is not None and by is not None:
            self.media.on_beacon(received.neighbour, by, address, beacon.media, now_ns)
        if is_main:
            received.neighbour.by_unicast = not by_multicast
        if received.clock_sample is not None:
            self._clock_samples.on_sample(received.clock_sample)
        if received.values:
            actions.append(WriteMirrors(received.values))
        if received.unsigned:
            actions.append(ReportUnsignedValues(received.unsigned))
        if received.structure is not None:
            actions.append(WriteStructure(received.structure))
        if received.first_hello:
            self._protocol.hellos.schedule()
        if received.links or received.routes:
            self._on_changes(received.links, received.routes, actions, now_ns)
        if received.first_hello or received.links or received.is_asked:
            self._triggered = True
        return True, actions

    def check(self, header: Header, beacon: Beacon, clear: bytes, body: bytes, host: str) -> CheckedDatagram:
        """Checks who made a datagram with a valid seal; without keys that is its sender."""
        checks = self._protocol.checks
        if checks is None:
            return CheckedDatagram(host)
        return checks.on_datagram(header, beacon, clear, body, host)

    def on_impersonation(self, host: str, now_ns: int) -> list[Action]:
        """Another member has sealed a beacon in the name of this node."""
        self.counters.refused.impersonated += 1
        return [ReportImpersonation(self.identity.hw, host)]

    def _on_copy(
        self, media: MediumTable, header: Header, address: Address, size: int, now_ns: int, by: ByMedium
    ) -> bool:
        known = self._sessions.present(header.sender_hw) == header.session
        name = self.nodes.platform(header.sender_hw) if known else UNACCEPTED
        self.counters.datagram_received(size, name, transport_of(by)).duplicates += 1
        if known:
            media.on_copy(header.sender_hw, by, address, now_ns)
        return known

    def _on_outcome(
        self, hw: int, session: int, outcome: SessionOutcome, actions: list[Action], now_ns: int
    ) -> None:
        if outcome.adopted:
            actions.append(AdoptSession(hw, session))
        if outcome.prove:
            actions.append(ProveSession(hw, self.session))
        if outcome.duplicate:
            first = not self._duplicate_ns
            self._duplicate_ns = now_ns
            actions.append(ReportDuplicate(self.nodes.platform(hw), hw == self.identity.hw, first))
        if outcome.soon:
            self._protocol.hellos.schedule()
            self._triggered = True
        if not outcome.accepted:
            refused, present = self.counters.refused, self._sessions.present(hw)
            if present is not None and session < present:
                refused.old_session += 1
            else:
                refused.unproven += 1

    def _on_changes(
        self, links: list[LinkChanged], routes: list[RouteChanged], actions: list[Action], now_ns: int
    ) -> None:
        actions += links
        if links or routes:
            self._tables_changed = True
        if self.exchange is not None:
            for link in links:
                if link.after is LinkState.DOWN:
                    self.exchange.forget(link.hw)
        is_silent = any(change.event is LinkEvent.SILENT for change in links)
        if is_silent or any(not change.via for change in routes):
            self._triggered = True  # so that other nodes learn of it soon

    def on_proof(self, hw: int, session: int, now_ns: int) -> list[Action]:
        """Takes the proof of a session, over a connection that only the key of the node opens."""
        self._sessions.on_proof(hw, session, now_ns)
        return []

    # the roster

    def on_roster_actions(self, found: list[RosterAction], now_ns: int) -> list[Action]:
        """Takes what the exchange of the roster has decided: a new roster changes who is received."""
        actions = list[Action](found)
        for action in found:
            if isinstance(action, ApplyRoster):
                self._on_roster(action.change, actions, now_ns)
        return actions

    def _on_roster(self, change: RosterChange, actions: list[Action], now_ns: int) -> None:
        assert self.exchange is not None, "without keys there is no roster"
        self._protocol.hellos.set_roster_version(change.roster.version)
        self.targets.on_roster()
        self._triggered = True
        self.add_members((member.platform for member in change.roster.valid()), now_ns)
        gone = {member.platform for member in change.gone}
        for hw in self.nodes.units_of(gone):
            if hw != self.identity.hw:
                self._sessions.forget(hw)
                self._on_changes(*self._protocol.forget(hw, now_ns), actions, now_ns)
        if gone:
            self._tables_changed = True
            self._protocol.drop_subscriptions(gone)
            actions.append(KeepMirrors(self._protocol.wants()))

    # beacons

    def compose(self, now_ns: int) -> OutgoingBeacon:
        """The next beacon; also schedules the one after it."""
        self.beacon_due = False
        protocol, sessions = self._protocol, self._sessions
        if self.exchange is not None:
            up = (neighbour.hw for neighbour in self._neighbours.up())
            if self.exchange.switch_epoch(up, now_ns):
                protocol.hellos.schedule()  # with the session: others open it with another key from now on
        try:
            if sessions.meets:
                protocol.structures.offer()
            signature_bytes = 0 if self.signatures is None else PART_BYTES
            protocol.reserved_bytes = session_checks.body_bytes(sessions.waiting) + signature_bytes
            outgoing = protocol.compose(now_ns)
        finally:
            self._schedule.set_next(now_ns, self._period_ns())
        if not sessions.waiting:
            return outgoing
        beacon = msgspec.structs.replace(outgoing.beacon, checks=sessions.due(now_ns))
        return msgspec.structs.replace(outgoing, beacon=beacon)

    def on_sent(self, sequence: int, size: int, now_ns: int) -> list[Action]:
        """A beacon was sent, stamped with this instant."""
        self._protocol.sent(sequence, now_ns, size)
        return []

    # settings of the tree and of operators

    def on_plan(self, plan: TreePlan, now_ns: int) -> list[Action]:
        """Takes the publications and subscriptions of the tree."""
        values, structures = self._protocol.set_plan(plan)
        return [KeepMirrors(plan.wants), WriteMirrors(values), *map(WriteStructure, structures)]

    # queries

    def has_link(self, hw: int) -> bool:
        """Whether a node is or was a neighbour."""
        return self._neighbours.get(hw) is not None

    def board_path(self, origin_hw: int, data_id: int) -> str:
        """Path of a subscribed or own board; its data id where it is neither."""
        return self._protocol.board_path(origin_hw, data_id)

    def clock_bound_ns(self, hw: int, now_ns: int) -> int | None:
        """Lower bound of a neighbour's clock, which its beacons show, or None if it is not known."""
        neighbour = self._neighbours.get(hw)
        if neighbour is None or neighbour.hello is None:
            return None
        elapsed_ns = now_ns - neighbour.received_ns
        return neighbour.clock_us * 1000 + elapsed_ns - elapsed_ns // RATE_DIVISOR

    def is_up(self, hw: int) -> bool:
        """Whether the link to a node is up."""
        neighbour = self._neighbours.get(hw)
        return neighbour is not None and neighbour.state is LinkState.UP

    def usual_period_ns(self) -> int:
        """Median time between two datagrams of a neighbour."""
        return self._neighbours.usual_period_ns()
