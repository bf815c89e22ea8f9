"""The beacon protocol of a node: interprets received beacons, and composes the next one."""

from collections.abc import Callable, Collection
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, NEVER_NS, Beacon, Header, Hello, OutgoingBeacon
from swarmd.broker.core.beacon.beacon_codec import (
    ECHO_BYTES,
    REQUEST_BYTES,
    ROW_BYTES,
    hello_bytes,
    member_bytes,
    relay_bytes,
    value_bytes,
)
from swarmd.broker.core.beacon.beacon_rate import CHANGING_HZ, MIN_HZ, TRIGGERED_NS, Slowdown, allowed_hz
from swarmd.broker.core.beacon.declared_period import DeclaredPeriod
from swarmd.broker.core.beacon.hello_schedule import SILENCE_NS, SLOWER, HelloSchedule, Moment, NodeIdentity
from swarmd.broker.core.beacon.parts.medium_parts import media_bytes
from swarmd.broker.core.beacon.parts.solicitation import Solicitation, solicitation_bytes
from swarmd.broker.core.beacon.parts.value_proof import ValueProof
from swarmd.broker.core.beacon.proof_parts import proofs_bytes
from swarmd.broker.core.beacon.request_parts import request_part_bytes
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.boards.published_boards import PublishedBoards
from swarmd.broker.core.boards.received_values import ReceivedValues
from swarmd.broker.core.boards.relay_cache import RelayCache, RemoteValue
from swarmd.broker.core.boards.structure_broadcasts import StructureBroadcasts
from swarmd.broker.core.membership.signatures.own_signatures import SigningKeys
from swarmd.broker.core.membership.signatures.signature_checks import SignatureChecks, UnsignedValue
from swarmd.broker.core.swarm.clock_batches import ClockSample
from swarmd.broker.core.swarm.links.link import LinkChanged
from swarmd.broker.core.swarm.neighbour import CLOCK_HIGH_MAX, PERIODS, Neighbour
from swarmd.broker.core.swarm.neighbours.medium_table import MediumTable
from swarmd.broker.core.swarm.node_table import NodeTable
from swarmd.broker.core.swarm.routes.routing_table import RouteChanged
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import IP_UDP_BYTES, Counters
from swarmware.runtime.loop_delay import LoopDelay
from swarmware.types.net import BoardSubscription, StructureBroadcast, TreePlan


class ReceivedBeacon(msgspec.Struct, frozen=True, gc=False):
    """Result of a received beacon."""

    neighbour: Neighbour
    clock_sample: ClockSample | None
    links: list[LinkChanged]
    routes: list[RouteChanged]
    values: list[tuple[BoardSubscription, RemoteValue]]
    """Values of subscribed boards."""
    structure: StructureBroadcast | None
    """Structure of its tree."""
    first_hello: bool
    """First hello of a new or restarted neighbour: answer soon with an own hello."""
    is_asked: bool
    """The neighbour asks for a beacon of this node."""
    unsigned: list[UnsignedValue]
    """Relayed values without a valid proof."""


OWN_SHARE: Final = 700
"""Limit in bytes of the topology sections; the rest of the body is for values, members and relays."""
SETTLE_NS: Final = 15_000_000_000
"""No beacon is skipped for this time after a link change: a new clock is measured with all of them."""
ANSWER_FALL: Final = 2.0
"""A time to answer is stated again when it has fallen by this factor, or risen by SLOWER."""
ANSWER_SHARE: Final = 0.5
"""Limit of the time to answer, as a share of the declared period: a slower node does not answer, because
its next beacon is as soon."""
_FORGET_NS: Final = 10_000_000_000
_FIRST_DATAGRAM_BYTES: Final = 150.0


class BeaconProtocol:
    """Neighbours, routes, names, published and relayed boards of one node."""

    def __init__(
        self,
        identity: NodeIdentity,
        topology: Topology,
        counters: Counters,
        config: Config,
        *,
        declared_period: DeclaredPeriod | None = None,
        media: MediumTable | None = None,
        channels: ChannelTable | None = None,
        signing: SigningKeys | None = None,
    ) -> None:
        """`media`: None on a node with one network; `signing`: None without keys."""
        self._media = media
        self.identity = identity
        self.topology = topology
        self.counters = counters
        self.channels = channels or ChannelTable()
        self.nodes = NodeTable(identity.hw)
        self.published = PublishedBoards()
        self.checks = (
            SignatureChecks(signing, self.nodes.platform, has_copies=media is not None)
            if signing is not None
            else None
        )
        """None without keys: nothing is signed."""
        self.relay_cache = RelayCache(must_prove=signing is not None)
        self._received = ReceivedValues(
            identity.hw, self.relay_cache, counters, topology.neighbours.get, self.checks
        )
        self.hellos = HelloSchedule(identity, config.tick_hz)
        self.structures = StructureBroadcasts(identity.hw)
        self.slowdown = Slowdown()
        self.delay = LoopDelay()
        """A node that is late declares a period by which neighbours keep its links when it is late again."""
        self.reserved_bytes = 0
        """Bytes of the next body kept free for session checks and the signature."""
        self._busy_hz = config.tick_hz
        self._relay_bytes_s = config.relay_bytes_s
        self._plan = TreePlan(0)
        self._limits_version = 0
        self._forget_ns = NEVER_NS
        self._sent_ns = NEVER_NS
        self._now_ns = NEVER_NS
        self._gap_ns = 0
        """Time between the last two own beacons."""
        self._declared_period = declared_period or DeclaredPeriod(0, NEVER_NS)
        self._relaying = False
        self._relay_room = 0.0
        """Bytes of the relay budget that are left."""
        self._datagram_bytes = _FIRST_DATAGRAM_BYTES
        self._answer_ms = 0
        """Time to answer a solicitation that was stated last."""

    def set_plan(
        self, plan: TreePlan
    ) -> tuple[list[tuple[BoardSubscription, RemoteValue]], list[StructureBroadcast]]:
        """Sets publications and subscriptions; returns cached values of the newly subscribed boards, and
        received structures that are needed from now on."""
        self.hellos.set_plan(plan, self._now_ns)
        self._plan = plan
        structures = self.structures.set_plan(plan)
        self.published.offer(plan.offers, self.channels.board_max_hz)
        return self._received.subscribe(plan.wants), structures

    @property
    def busy(self) -> bool:
        """Whether boards of this node have subscribers, or boards of others are relayed."""
        return bool(self.published.boards) or self._relaying

    def beacon_hz(self) -> float:
        """Present rate of the node's beacons."""
        if self.busy or self.topology.is_new(self._now_ns):
            wanted_hz = self._busy_hz
        else:
            is_changing = self.topology.is_changing(self._now_ns)
            wanted_hz = min(CHANGING_HZ if is_changing else self.hellos.quiet_rate.hz(), self._busy_hz)
        return max(min(wanted_hz, self.allowed_hz()) / self.slowdown.factor, MIN_HZ)

    def allowed_hz(self) -> float:
        """Maximum beacon rate for the capacity of the channel."""
        neighbours = self.topology.neighbours.active_count()
        in_air = allowed_hz(neighbours, self._datagram_bytes + IP_UDP_BYTES)
        if self._media is None:
            return in_air
        return max(min(in_air, self._media.beacon_hz(self._datagram_bytes, self._now_ns)), MIN_HZ)

    def on_beacon(
        self,
        header: Header,
        beacon: Beacon,
        address: tuple[str, int],
        rx_ns: int,
        proof: ValueProof | None = None,
    ) -> ReceivedBeacon | None:
        """Takes a genuine beacon, with the proof of its values to others; returns None if it is malformed,
        or the neighbour table is full."""
        hw = header.sender_hw
        if hw in (0, self.identity.hw):
            self.counters.refused.malformed += 1
            return None
        known = self.topology.neighbours.get(hw)
        restarted = False
        if header.session is not None and known is not None:
            restarted = known.session not in (0, header.session)
        first_hello = False
        if beacon.hello is not None:
            # a clock beyond this range would overflow the differences from which offsets are computed
            clock_fits = abs(beacon.hello.clock_high) <= CLOCK_HIGH_MAX
            if not clock_fits or not self.nodes.on_hello(hw, beacon.hello, rx_ns):
                self.counters.refused.malformed += 1
                return None
            first_hello = known is None or known.hello is None or restarted
        # a neighbour to which others had a route shares their names already
        names_needed = first_hello and (restarted or self.topology.routing.next_hop(hw) in (hw, 0))
        update = self.topology.on_beacon(header, beacon, restarted, address, rx_ns)
        if update is None:
            self.counters.refused.no_room += 1
            return None
        neighbour = update.neighbour
        if header.session is not None:
            neighbour.session = header.session
        # stamps of two sessions are not comparable, as each has a clock of its own
        if restarted:
            self.relay_cache.forget_origin(hw)
        routing = self.topology.routing
        for row in beacon.members:
            # the next hop has the newest tree version; a name is checked against the hardware id
            if row.hw != self.identity.hw and (
                routing.next_hop(row.hw) in (hw, 0) or self.nodes.get(row.hw) is None
            ):
                self.nodes.on_row(row, rx_ns)
        if names_needed:
            self.nodes.announce_again()
        values = []
        if beacon.values or beacon.relays:
            signature, clock_high = beacon.signature, neighbour.clock_us >> 32 & 0xFFFF
            if signature is not None and signature.clock_high != clock_high:
                proof = None  # of other stamps than the hello's clock gives: no node could verify it
            values = self._received.take(neighbour, beacon, rx_ns, proof)
        unsigned, self._received.unsigned = self._received.unsigned, []
        structure: StructureBroadcast | None = None
        if (beacon.structure is not None or beacon.structure_questions) and neighbour.hello is not None:
            name = neighbour.hello.name
            structure = self.structures.on_beacon(hw, name, beacon, rx_ns)
        return ReceivedBeacon(
            neighbour,
            update.clock_sample,
            update.links,
            update.routes,
            values,
            structure,
            first_hello,
            update.is_asked,
            unsigned,
        )

    def advance(self, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Handles deadlines and expiry; call at each beacon and at `deadline_ns`."""
        self._now_ns = now_ns
        self.channels.advance(now_ns)
        if self.channels.version != self._limits_version:
            self._limits_version = self.channels.version
            self.published.offer(self._plan.offers, self.channels.board_max_hz)
        # both tables are swept seldom; entries live for minutes
        if now_ns >= self._forget_ns:
            self._forget_ns = now_ns + _FORGET_NS
            self.relay_cache.forget(now_ns)
            self.nodes.forget(now_ns)
        return self.topology.advance(now_ns)

    def deadline_ns(self) -> int | None:
        """Instant by which `advance` must be called, or None without a deadline."""
        return self.topology.deadline_ns()

    def forget(self, hw: int, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Removes everything about a node that is not a member any more."""
        self.nodes.remove(hw)
        self.relay_cache.forget_origin(hw)
        return self.topology.exclude(hw, now_ns)

    def drop_subscriptions(self, platforms: Collection[str]) -> None:
        """Ends the subscriptions to the boards of platforms that are not members any more."""
        self._received.drop(platforms)

    def wants(self) -> tuple[BoardSubscription, ...]:
        """The boards that this node subscribes to."""
        return self._received.wants()

    def board_path(self, origin_hw: int, data_id: int) -> str:
        """Path of a subscribed or own board; its data id where it is neither."""
        if origin_hw == self.identity.hw and (board := self.published.boards.get(data_id)) is not None:
            return board.path
        return self._received.path(origin_hw, data_id) or f"{data_id:08x}"

    def may_skip(self, now_ns: int) -> bool:
        """Whether the next beacon may be skipped: it has no change that must be sent now."""
        # at rest every beacon is needed; neighbours measure loss and clocks with two a second
        if not self.busy or self.hellos.is_scheduled or now_ns - self._sent_ns >= self.hellos.silence_ns():
            return False
        if self.structures.is_due(now_ns):
            return False
        if self.topology.is_changing(now_ns, SETTLE_NS):
            return False
        if self.published.has_changes(now_ns, round(1e9 / self.beacon_hz()), SILENCE_NS):
            return False
        return not self.relay_cache.has_changes(now_ns, *self._relay_terms(now_ns))

    def _relay_terms(self, now_ns: int) -> tuple[frozenset[int], Callable[[int, set[int]], bool]]:
        """Nodes that all neighbours receive, and the test whether one of them needs an origin's value."""
        neighbours = self.topology.neighbours
        return neighbours.common(now_ns), lambda origin_hw, have: neighbours.needed(origin_hw, have, now_ns)

    def compose(self, now_ns: int) -> OutgoingBeacon:
        """Composes the next beacon; sections get their bytes in the order of importance."""
        hello = self._hello(now_ns)
        room = BODY_LIMIT - 16 - self.reserved_bytes - (hello_bytes(hello) if hello is not None else 0)
        media = () if self._media is None else self._media.listings(now_ns, OWN_SHARE // 4)
        # from here each section gets the room that the more important ones have left
        room -= media_bytes(len(media))
        section = self.topology.compose(now_ns, min(room, OWN_SHARE))
        room -= (
            len(section.echoes) * ECHO_BYTES
            + len(section.rows) * ROW_BYTES
            + len(section.requests) * REQUEST_BYTES
            + request_part_bytes(section.neighbour_requests)
        )
        solicitation = self._solicitation(section.asked, now_ns, has_hello=hello is not None)
        room -= solicitation_bytes(len(section.asked)) if solicitation is not None else 0
        hz = self.beacon_hz()
        # own values before relayed ones; other nodes can relay those, too
        values = self.published.values(now_ns, room, round(1e9 / hz))
        room -= sum(value_bytes(value.payload) for value in values)
        for value in values:
            channel = self.counters.channel(self.published.boards[value.data_id].path)
            channel.sent(len(value.payload))
        # without a neighbour a structure would be sent to no node and count as announced
        has_neighbours = self.topology.neighbours.active_count() > 0
        structures = self.structures.compose(now_ns, room, has_neighbours=has_neighbours)
        room -= structures.bytes
        common, needed = self._relay_terms(now_ns)
        members = self.nodes.rows(now_ns, room, common, self.topology.routing.next_hop)
        room -= sum(member_bytes(member) for member in members)
        # the budget of skipped beacons counts too, and what one beacon leaves is for the next one
        span_s = min(max((now_ns - self._sent_ns) / 1e9, 1 / hz), SILENCE_NS / 1e9 + 1 / hz)
        self._relay_room = min(self._relay_room, self._relay_bytes_s / hz) + self._relay_bytes_s * span_s
        relays = self.relay_cache.compose(now_ns, min(room, int(self._relay_room)), common, needed)
        self._relay_room -= sum(relay_bytes(relay.payload) for relay in relays) + proofs_bytes(relays)
        # keeps the busy rate for a moment, so that the rate does not flap between two relayed values
        self._relaying = bool(relays) or (self._relaying and self.relay_cache.relayed_recently(now_ns))
        beacon = Beacon(
            hello,
            section.echoes,
            section.rows,
            section.requests,
            tuple(members),
            tuple(values),
            tuple(relays),
            structure=structures.structure,
            structure_questions=structures.questions,
            media=media,
            neighbour_requests=section.neighbour_requests,
            solicitation=solicitation,
        )
        # written to disk by the shell before the beacon is sent; a restarted node must wait as long
        rose = hello is not None and self._declared_period.declare(self.hellos.declared_ns, now_ns)
        period_ns = self._declared_period.ns if rose else 0
        return OutgoingBeacon(self.topology.next_sequence(), hello is not None, beacon, period_ns)

    def _solicitation(self, asked: tuple[int, ...], now_ns: int, *, has_hello: bool) -> Solicitation | None:
        """The neighbours that the beacon asks, and the own time to answer.

        The time goes with hellos while links change or the rate falls, and otherwise when it has changed: a
        node at rest does not repeat it, and a node at 10 Hz never states it.
        """
        answer_ms = min(self._answer_ns(now_ns) // 1_000_000 + 1, 0xFFFF)
        # 0 is stated; the node does not answer, because its next beacon is as soon
        if ANSWER_SHARE * self.hellos.declared_ns < answer_ms * 1_000_000:
            answer_ms = 0
        known_ms = self._answer_ms
        has_changed = not known_ms / ANSWER_FALL <= answer_ms <= known_ms * SLOWER
        is_changing = self.topology.is_changing(now_ns) or self.hellos.quiet_rate.is_falling
        if not asked and not (has_hello and (has_changed or (answer_ms and is_changing))):
            return None
        self._answer_ms = answer_ms
        return Solicitation(answer_ms, asked)

    def _answer_ns(self, now_ns: int) -> int:
        """Time until a triggered beacon is sent, at the latest."""
        return TRIGGERED_NS + round(1e9 / self.allowed_hz()) + self.delay.recent_ns(now_ns)

    def _hello(self, now_ns: int) -> Hello | None:
        topology = self.topology
        moment = Moment(
            now_ns,
            self._sent_ns,
            self._gap_ns,
            max(round(1e9 / self.beacon_hz()), round(self.delay.recent_ns(now_ns) / PERIODS)),
            self.busy,
            topology.is_changing(now_ns),
            topology.is_new(now_ns),
            topology.neighbours.listing_ns(),
        )
        return self.hellos.next_hello(moment)

    def sent(self, sequence: int, tx_ns: int, datagram_bytes: int) -> None:
        """Records a sent beacon."""
        self._gap_ns = 0 if self._sent_ns == NEVER_NS else tx_ns - self._sent_ns
        self._sent_ns = tx_ns
        more = datagram_bytes - self._datagram_bytes
        # rises fast, falls slowly: too few beacons are better than too many
        self._datagram_bytes += more / (4 if more > 0 else 16)
        self.topology.sent(sequence, tx_ns)
