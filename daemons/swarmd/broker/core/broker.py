"""The broker's core: beacons, sessions, rate limits and tables of one node."""

from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.action import (
    Action,
    AdoptSession,
    KeepMirrors,
    PollInputs,
    ProveSession,
    PublishTables,
    ReportContradictions,
    ReportDuplicate,
    ReportDuplicateGone,
    ReportSlowdown,
    SendBeacon,
    WriteClockSamples,
    WriteLimits,
    WriteMirrors,
    WriteStructure,
)
from swarmd.broker.core.admission.origins import RATE_DIVISOR
from swarmd.broker.core.admission.roster_exchange import ApplyRoster, RosterAction, RosterExchange
from swarmd.broker.core.admission.sessions import ACCEPTED, SessionOutcome, Sessions
from swarmd.broker.core.beacon import session_checks
from swarmd.broker.core.beacon.beacon import Beacon, Header, Hello
from swarmd.broker.core.beacon.beacon_rate import BeaconSchedule
from swarmd.broker.core.beacon.declared_period import DeclaredPeriod
from swarmd.broker.core.beacon_protocol import SETTLE_NS, BeaconProtocol, NodeIdentity, OutgoingBeacon
from swarmd.broker.core.forwarding.end_to_end import SigningKeys
from swarmd.broker.core.forwarding.forwarder import FrameForwarder
from swarmd.broker.core.report import NetReport
from swarmd.broker.core.structure_broadcasts import StructureBroadcasts
from swarmd.broker.core.topology.clock_sample import ClockSample
from swarmd.broker.core.topology.link import LinkChanged, LinkEvent, LinkState
from swarmd.broker.core.topology.routing_table import RouteChanged
from swarmd.broker.core.topology.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.runtime.core import AT_ONCE
from swarmware.transport.security.roster import RosterChange
from swarmware.types.net import UNACCEPTED, ChannelLimits, SetChannel, TimingBatch, TimingSample, TreePlan

DUPLICATE_NS: Final = 5_000_000_000
"""A duplicate of a platform name is cleared after this time without a datagram of the second computer."""
PUBLISH_NS: Final = 1_000_000_000
"""Period of the tables of neighbours, routes and traffic."""
SAMPLES_NS: Final = 490_000_000
"""Time between two batches of clock samples while no link is new: clocks are estimated from them every three
seconds. A little less than half a second, so that the batch is due at every fifth check at 10 Hz."""
SAMPLES_MAX: Final = 48
"""Samples after which a batch is written without waiting: they fit a slot of their stream."""
CLAIMANTS_MAX: Final = 16
CLAIMANT_NS: Final = 3_000_000_000
PROMISED: Final = frozenset({Kind.STREAM, Kind.EVENT})
"""Kinds with guaranteed delivery of every item: rate limits do not apply to them."""
_SEQUENCE_NS: Final = 100_000_000
"""Sequence numbers start at the wall clock in beacons of 10 Hz: above those of a former session."""

Address = tuple[str, int]


class FormerState(msgspec.Struct, frozen=True):
    """State of the former session of this node's broker."""

    declared_period_ns: int = 0
    """Longest time between two datagrams that it declared; 0: none is known."""
    quiet_ns: int = 0
    """Time for which other nodes may still route through it, in ns."""


class LinkTarget(msgspec.Struct, frozen=True):
    """Target of a connection to a neighbour."""

    platform: str
    host: str
    tcp_port: int
    curve_public: bytes
    """The key that it announced itself; empty where the key is on the roster."""
    session: int
    frame_port: int = 0
    """UDP port for frames as datagrams; 0: none."""


class BrokerCore:
    """Decides when beacons are sent, which sessions are accepted, and what is reported."""

    def __init__(
        self,
        identity: NodeIdentity,
        config: Config,
        session: int,
        *,
        connections: bool,
        former: FormerState,
        now_ns: int,
        chance: Callable[[], float],
        exchange: RosterExchange | None = None,
        signing: SigningKeys | None = None,
    ) -> None:
        """`connections`: whether sessions can be proven over connections; not without keys. `exchange`: of
        the roster, `signing`: of structures; None without keys.

        `chance`: uniform from 0 to 1, for the jitter of beacons.
        """
        self.identity = identity
        self.counters = Counters()
        topology = Topology(
            identity.hw,
            session // _SEQUENCE_NS & 0x7FFF_FFFF,
            round(config.link_timeout_s * 1e9),
            now_ns + former.quiet_ns,
        )
        self._neighbours = topology.neighbours
        self._protocol = protocol = BeaconProtocol(
            identity,
            topology,
            self.counters,
            busy_hz=config.tick_hz,
            relay_bytes_s=config.relay_bytes_s,
            declared_period=DeclaredPeriod(former.declared_period_ns, now_ns),
            structures=StructureBroadcasts(identity.hw, session, signing, self.counters.refused),
        )
        self.exchange = exchange
        if exchange is not None:
            protocol.set_roster_version(exchange.version)
        self.nodes = protocol.nodes
        self.published = protocol.published
        self.forwarder = FrameForwarder(identity.hw, topology.routing)
        self._by_unicast: set[int] = set()
        """Neighbours whose newest datagram came by unicast."""
        self.report = NetReport(protocol, topology, self.counters, self._by_unicast, now_ns)
        self.session = session
        self._sessions = Sessions(identity.hw, session, connections=connections)
        self._schedule = BeaconSchedule(now_ns, chance)
        self._publish_ns = now_ns
        self._tables_changed = False
        self._triggered = False
        """A beacon is to be triggered. Its jitter counts from the next step, because many nodes read their
        datagrams in batches at the same instants."""
        self._boards_asked = False
        self._links_ns: int | None = None
        """Deadline of the links when the inputs were read last; datagrams since then only move it later."""
        self._duplicate_ns = 0
        self._clock_samples: list[ClockSample] = []
        """Samples since the last batch."""
        self._samples_ns = now_ns
        """Instant from which the next batch may be written."""
        self._targets: dict[int, tuple[Hello, Address, LinkTarget]] = {}
        """Of neighbours that frames went to, with the hello and address that they follow from."""
        self._claimants: dict[Address, int] = {}
        """Unicast senders without an accepted session, and until when beacons are sent to them."""

    def add_members(self, platforms: Iterable[str], now_ns: int) -> None:
        """Takes the platforms on the roster: their names are known before they are received."""
        for platform in platforms:
            self.nodes.add(platform, now_ns)

    def set_ports(self, tcp_port: int, frame_port: int) -> None:
        """Sets the ports that hellos announce: of connections, and of frames as datagrams."""
        self._protocol.tcp_port = tcp_port
        self._protocol.frame_port = frame_port
        if self.exchange is not None:
            self.exchange.port = tcp_port

    # time

    def deadline_ns(self) -> int | None:
        """Instant of the next beacon, of the next tables, or of a silent link."""
        if self._tables_changed or self._triggered:
            return AT_ONCE
        due_ns = min(self._schedule.due_ns, self._publish_ns)
        asked_ns = None if self.exchange is None else self.exchange.deadline_ns()
        return min(each_ns for each_ns in (due_ns, self._links_ns, asked_ns) if each_ns is not None)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Requests the inputs: datagrams are received before the silence of their sender is judged."""
        self._boards_asked = now_ns >= self._schedule.due_ns
        return [PollInputs(self._boards_asked)]

    def on_inputs_read(self, now_ns: int) -> list[Action]:
        """Handles expired deadlines: silent links, expired routes and limits, the next beacon, the tables."""
        protocol, actions = self._protocol, list[Action]()
        limits = protocol.rate_limits
        version = limits.version
        self._on_changes(*protocol.advance(now_ns), actions, now_ns)
        if limits.version != version:
            actions.append(WriteLimits(limits.limits(now_ns)))
        if self._triggered:
            self._triggered = False
            self._schedule.trigger(now_ns, round(1e9 / protocol.allowed_hz()))
        if self._boards_asked and now_ns >= self._schedule.due_ns:
            self._boards_asked = False
            self._on_beacon_due(actions, now_ns)
        if self._tables_changed or now_ns >= self._publish_ns:
            self._publish(actions, now_ns)
        if self.exchange is not None:
            actions += self.exchange.advance(now_ns)
        self._links_ns = protocol.deadline_ns()
        return actions

    def _on_beacon_due(self, actions: list[Action], now_ns: int) -> None:
        schedule, slowdown = self._schedule, self._protocol.slowdown
        if slowdown.on_beacon(now_ns - schedule.due_ns, self._period_ns()):
            actions.append(ReportSlowdown(slowdown.factor, slowdown.late_ns))
        if self._are_samples_due(now_ns):
            self._write_clock_samples(actions)
            self._samples_ns = now_ns + SAMPLES_NS
        period_ns = self._period_ns()
        urgent = schedule.urgent or self._sessions.waiting > 0
        if not urgent and self._protocol.may_skip(now_ns + schedule.jitter_ns(period_ns)):
            schedule.skip(now_ns, period_ns)
        elif urgent or not schedule.defer_after_skip(now_ns, period_ns):
            schedule.on_sent(now_ns)
            actions.append(SendBeacon())

    def _are_samples_due(self, now_ns: int) -> bool:
        if not self._clock_samples:
            return False
        if now_ns >= self._samples_ns or len(self._clock_samples) >= SAMPLES_MAX:
            return True
        return self._protocol.topology.is_changing(now_ns, SETTLE_NS)

    def _write_clock_samples(self, actions: list[Action]) -> None:
        find = self.nodes.get
        samples = tuple(
            TimingSample(
                member.platform,
                member.unit,
                sample.hw,
                sample.boot_id,
                sample.rx_ns,
                sample.reverse_ns,
                sample.forward_tx_ns,
                sample.forward_ns,
            )
            for sample in self._clock_samples
            if (member := find(sample.hw)) is not None
        )
        self._clock_samples.clear()
        if samples:
            actions.append(WriteClockSamples(TimingBatch(samples)))

    def _publish(self, actions: list[Action], now_ns: int) -> None:
        is_period = now_ns >= self._publish_ns
        if is_period:
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
        self, header: Header, beacon: Beacon, address: Address, by_multicast: bool, size: int, now_ns: int
    ) -> tuple[bool, list[Action]]:
        """Takes an authenticated beacon, whose header names its session; whether that session is accepted."""
        hw, actions = header.sender_hw, list[Action]()
        assert header.session is not None, "the session is known from the key that opened the datagram"
        outcome = self._sessions.on_datagram(hw, header.session, beacon.checks, now_ns)
        if outcome is not ACCEPTED:
            self._on_outcome(hw, header.session, outcome, actions, now_ns)
            if not outcome.accepted:
                self.counters.datagram_received(size, UNACCEPTED)
                if not by_multicast and len(self._claimants) < CLAIMANTS_MAX:
                    self._claimants[address] = now_ns + CLAIMANT_NS
                return False, actions
        if self.exchange is not None:
            hello = beacon.hello
            if hello is not None and self.exchange.excludes_name(hw, hello.name):
                self.counters.refused.revoked += 1
                return False, actions
            beacon = self.exchange.without_excluded(beacon)
        received = self._protocol.on_beacon(header, beacon, address, now_ns)
        if received is None:
            self.counters.datagram_received(size, UNACCEPTED)
            return True, actions
        self.counters.datagram_received(size, self.nodes.platform(hw))
        if self.exchange is not None and beacon.hello is not None:
            self.exchange.on_shown(hw, self.nodes.platform(hw), beacon.hello.roster_version, now_ns)
        if by_multicast:
            self._by_unicast.discard(hw)
        else:
            self._by_unicast.add(hw)
        if received.clock_sample is not None:
            self._clock_samples.append(received.clock_sample)
        if received.values:
            actions.append(WriteMirrors(received.values))
        if received.contradictions:
            actions.append(ReportContradictions(received.contradictions))
        if received.structure is not None:
            actions.append(WriteStructure(received.structure))
        if received.first_hello:
            self._protocol.schedule_hello()
        if received.links or received.routes:
            self._on_changes(received.links, received.routes, actions, now_ns)
        if received.first_hello or received.links:
            self._triggered = True
        return True, actions

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
            self._protocol.schedule_hello()
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
        if any(not change.via for change in routes) or any(
            change.event is LinkEvent.SILENT for change in links
        ):
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
        self._protocol.set_roster_version(change.roster.version)
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
        protocol, sessions = self._protocol, self._sessions
        if self.exchange is not None:
            up = (neighbour.hw for neighbour in self._neighbours.up())
            if self.exchange.switch_epoch(up, now_ns):
                protocol.schedule_hello()  # with the session: others open it with another key from now on
        try:
            protocol.reserved_bytes = session_checks.body_bytes(sessions.waiting)
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

    def unicast_addresses(self, seeds: Iterable[Address], now_ns: int) -> set[Address]:
        """Addresses of seeds, of neighbours and of claimants that multicast does not reach."""
        if not seeds and not self._by_unicast and not self._claimants:
            return set()
        single: set[Address] = set()
        by_group: set[Address] = set()
        for neighbour in self._neighbours.all():
            if neighbour.state is not LinkState.DOWN:
                (single if neighbour.hw in self._by_unicast else by_group).add(neighbour.address)
        single.update(address for address in seeds if address not in by_group)
        self._claimants = {address: end_ns for address, end_ns in self._claimants.items() if end_ns > now_ns}
        single.update(self._claimants)
        return single

    # settings of the tree and of operators

    def on_plan(self, plan: TreePlan, now_ns: int) -> list[Action]:
        """Takes the publications and subscriptions of the tree."""
        return [KeepMirrors(plan.wants), WriteMirrors(self._protocol.set_plan(plan))]

    def on_set_channel(
        self, request: SetChannel, resources: Iterable[Resource], now_ns: int
    ) -> tuple[ChannelLimits, list[Action]]:
        """An operator limits the rate of boards, among the resources of this node.

        Raises: OutOfRange, InvalidInput when the request does not fit them.
        """
        if request.max_hz is not None and not 0 <= request.max_hz <= 1000:
            raise OutOfRange(f"max_hz {request.max_hz}: expected 0..1000, or none to remove the limit")
        if not 0 <= request.for_s <= 86_400:
            raise OutOfRange(f"for_s {request.for_s}: expected 0..86400 seconds")
        pattern = Pattern(request.pattern)
        matching = [resource for resource in resources if pattern.matches(resource.path)]
        unlimited = tuple(resource.path for resource in matching if resource.kind in PROMISED)
        if request.max_hz is not None and unlimited and len(unlimited) == len(matching):
            raise InvalidInput(
                f"pattern {request.pattern!r}: matches only {', '.join(unlimited[:3])}, whose items are"
                " all delivered; expected boards: the owner of a stream sets its rate"
            )
        self._protocol.rate_limits.set(request, now_ns)
        limits = self._protocol.rate_limits.limits(now_ns)
        return msgspec.structs.replace(limits, unlimited=unlimited), [WriteLimits(limits)]

    # queries

    def has_link(self, hw: int) -> bool:
        """Whether a node is or was a neighbour."""
        return self._neighbours.get(hw) is not None

    def board_path(self, origin_hw: int, data_id: int) -> str:
        """Path of a subscribed or own board; its data id where it is neither."""
        return self._protocol.board_path(origin_hw, data_id)

    def clock_bound_ns(self, hw: int, now_ns: int) -> int | None:
        """Lower bound of a neighbour's clock, which its beacons show; None: it is not known."""
        neighbour = self._neighbours.get(hw)
        if neighbour is None or neighbour.hello is None:
            return None
        elapsed_ns = now_ns - neighbour.received_ns
        return neighbour.clock_us * 1000 + elapsed_ns - elapsed_ns // RATE_DIVISOR

    def is_up(self, hw: int) -> bool:
        """Whether the link to a node is up."""
        neighbour = self._neighbours.get(hw)
        return neighbour is not None and neighbour.state is LinkState.UP

    def link_target(self, hw: int) -> LinkTarget | None:
        """Target of a connection to a neighbour; None: it has not announced a port."""
        neighbour = self._neighbours.get(hw)
        if neighbour is None or neighbour.hello is None or not neighbour.hello.tcp_port:
            self._targets.pop(hw, None)
            return None
        hello, address, session = neighbour.hello, neighbour.address, neighbour.session
        known = self._targets.get(hw)
        if known is not None and known[0] is hello and known[1] == address and known[2].session == session:
            return known[2]
        target = LinkTarget(
            self.nodes.platform(hw), address[0], hello.tcp_port, hello.curve_public, session, hello.frame_port
        )
        self._targets[hw] = hello, address, target
        return target

    def usual_period_ns(self) -> int:
        """Median time between two datagrams of a neighbour."""
        return self._neighbours.usual_period_ns()
