"""The beacon protocol of a node: interprets received beacons, and composes the next one."""

from collections.abc import Callable, Collection
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import (
    BODY_LIMIT,
    NEVER_NS,
    Beacon,
    BoardValue,
    Header,
    Hello,
    PlatformCode,
)
from swarmd.broker.core.beacon.beacon_codec import (
    ECHO_BYTES,
    REQUEST_BYTES,
    ROW_BYTES,
    hello_bytes,
    member_bytes,
    value_bytes,
)
from swarmd.broker.core.beacon.beacon_rate import (
    CHANGING_HZ,
    IDLE_HZ,
    MIN_HZ,
    QuietRate,
    Slowdown,
    allowed_hz,
)
from swarmd.broker.core.beacon.declared_period import DeclaredPeriod
from swarmd.broker.core.beacon.medium_parts import media_bytes
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.boards.claims import SETTLED_NS, OriginBeacon, OwnClaims
from swarmd.broker.core.boards.published_boards import PublishedBoards
from swarmd.broker.core.boards.relay_cache import RelayCache, RemoteValue
from swarmd.broker.core.media.medium_table import MediumTable
from swarmd.broker.core.received_beacon import ReceivedBeacon
from swarmd.broker.core.structure_broadcasts import StructureBroadcasts
from swarmd.broker.core.topology.link import LinkState
from swarmd.broker.core.topology.neighbour import CLOCK_HIGH_MAX, Neighbour
from swarmd.broker.core.topology.node_table import NodeTable
from swarmd.broker.core.topology.routing_table import RouteChanged
from swarmd.broker.core.topology.topology import LinkChanged, Topology
from swarmd.broker.core.traffic import IP_UDP_BYTES, ChannelCounters, Counters
from swarmware.model.names import Address, hardware_id
from swarmware.types.net import BoardSubscription, StructureBroadcast, TreePlan

HELLO_NS: Final = 2_000_000_000
"""Period of hellos."""
HELLO_CHANGING_NS: Final = 1_000_000_000
"""The same while links change (others come into range), and once after a change of tree or mission."""
SILENCE_NS: Final = 430_000_000
"""A node whose boards do not change sends a beacon in the first slot after this time: at 10 Hz every half
second, as a node without subscribers."""
FIRST_SILENCE_NS: Final = 350_000_000
"""The same until hellos have declared it: neighbours tolerate the loss of one datagram."""
ROSTER_HELLOS: Final = 3
"""Consecutive beacons with a hello after a change of the roster: two may be lost."""
REST_HELLOS: Final = 3
"""Consecutive hellos that declare the longer period: one may be lost."""
OWN_SHARE: Final = 700
"""Limit in bytes of the topology sections; the rest of the body is for values, members and relays."""
SETTLE_NS: Final = 15_000_000_000
"""No beacon is skipped for this time after a link change: a new clock is measured with all of them."""
DIRECT_PERIODS: Final = 2.5
"""Declared periods since the last beacon of an origin in which relayed values of its boards are not used."""
SLOWER: Final = 1.25
"""A period that grew by this factor is declared at once, or neighbours would take the link down."""
_FORGET_NS: Final = 10_000_000_000
_FIRST_DATAGRAM_BYTES: Final = 150.0


class NodeIdentity(msgspec.Struct, frozen=True):
    """Identity of this node in its hellos."""

    hw: int
    platform: str
    unit: str
    kind: PlatformCode
    boot_id: int
    curve_public: bytes
    """Empty where the key is on the roster."""


class _Subscription:
    """A subscribed board of another node."""

    __slots__ = ("channel", "want")

    def __init__(self, want: BoardSubscription) -> None:
        self.want = want
        self.channel: ChannelCounters | None = None
        """Its counters; None until the first value."""


class OutgoingBeacon(msgspec.Struct, frozen=True, gc=False):
    """The next beacon, before encoding."""

    sequence: int
    with_session: bool
    beacon: Beacon
    declared_period_ns: int = 0
    """Longest declared period, to be stored before sending; 0: unchanged."""
    is_signed: bool = False
    """It has room for a signature, and needs one."""


class BeaconProtocol:
    """Neighbours, routes, names, published and relayed boards of one node."""

    def __init__(
        self,
        identity: NodeIdentity,
        topology: Topology,
        counters: Counters,
        *,
        busy_hz: float,
        relay_bytes_s: float,
        declared_period: DeclaredPeriod | None = None,
        structures: StructureBroadcasts | None = None,
        media: MediumTable | None = None,
        channels: ChannelTable | None = None,
    ) -> None:
        """`media`: where there are several; None: one network."""
        self._media = media
        self.identity = identity
        self.topology = topology
        self.counters = counters
        self.channels = channels or ChannelTable()
        self.nodes = NodeTable(identity.hw)
        self.published = PublishedBoards()
        self.relay_cache = RelayCache()
        self._own_claims = OwnClaims(identity.hw)
        self._composed: list[BoardValue] = []
        """Own values of the beacon that was composed last."""
        self.structures = structures or StructureBroadcasts(identity.hw, 0, None, counters.refused)
        self.slowdown = Slowdown()
        self._quiet_rate = QuietRate()
        self.tcp_port = 0
        self.frame_port = 0
        self._roster_version = 0
        self._announcements = 0
        """Beacons from the next one on that have a hello, as the roster has changed."""
        self.reserved_bytes = 0
        """Bytes of the next body kept free for session checks."""
        self._busy_hz = busy_hz
        self._relay_bytes_s = relay_bytes_s
        self._plan = TreePlan(0)
        self._limits_version = 0
        self._subscriptions: dict[tuple[int, int], _Subscription] = {}
        """Subscriptions by origin and data id."""
        self._hello_ns = NEVER_NS
        self._replanned_ns = NEVER_NS
        """Instant of the last change of tree or mission, which hellos announce."""
        self._forget_ns = NEVER_NS
        self._sent_ns = NEVER_NS
        self._now_ns = NEVER_NS
        self._gap_ns = 0
        """Time between the last two own beacons."""
        self._declared_period = declared_period or DeclaredPeriod(0, NEVER_NS)
        self._declared_ns = 0
        """Period declared by the last hello."""
        self._rest_hellos = 0
        """Consecutive hellos that declared the period of a node at rest."""
        self._relaying = False
        self._datagram_bytes = _FIRST_DATAGRAM_BYTES

    def set_plan(self, plan: TreePlan) -> list[tuple[BoardSubscription, RemoteValue]]:
        """Sets publications and subscriptions; returns cached values of the newly subscribed boards."""
        if plan.tree_version != self._plan.tree_version or plan.mission != self._plan.mission:
            self._hello_ns = NEVER_NS
            self._replanned_ns = self._now_ns
        self._plan = plan
        self.structures.set_plan(plan)
        self.published.offer(plan.offers, self.channels.max_hz)
        wants = {
            (hardware_id(want.platform, want.unit), want.data_id): _Subscription(want) for want in plan.wants
        }
        cached: list[tuple[BoardSubscription, RemoteValue]] = []
        for key, subscription in wants.items():
            if key not in self._subscriptions and (remote := self.relay_cache.newest(*key)) is not None:
                cached.append((subscription.want, remote))
        self._subscriptions = wants
        return cached

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
            wanted_hz = min(CHANGING_HZ if is_changing else self._quiet_rate.hz(), self._busy_hz)
        return max(min(wanted_hz, self.allowed_hz()) / self.slowdown.factor, MIN_HZ)

    def allowed_hz(self) -> float:
        """Maximum beacon rate for the capacity of the channel."""
        neighbours = self.topology.neighbours.active_count()
        in_air = allowed_hz(neighbours, self._datagram_bytes + IP_UDP_BYTES)
        if self._media is None:
            return in_air
        return max(min(in_air, self._media.beacon_hz(self._datagram_bytes, self._now_ns)), MIN_HZ)

    def on_beacon(
        self, header: Header, beacon: Beacon, address: tuple[str, int], rx_ns: int
    ) -> ReceivedBeacon | None:
        """Takes an authenticated beacon. None: it is malformed, or the neighbour table is full."""
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
        values = self._take_values(neighbour, header, beacon, rx_ns) if beacon.values or beacon.relays else []
        contradictions, self.relay_cache.contradictions = self.relay_cache.contradictions, []
        self.counters.refused.contradicted += len(contradictions)
        structure: StructureBroadcast | None = None
        if (beacon.structure is not None or beacon.structure_questions) and neighbour.hello is not None:
            name = neighbour.hello.name
            structure = self.structures.on_beacon(hw, name, neighbour.session, beacon, rx_ns)
        return ReceivedBeacon(
            neighbour,
            update.clock_sample,
            update.links,
            update.routes,
            values,
            structure,
            first_hello,
            contradictions,
        )

    def _take_values(
        self, neighbour: Neighbour, header: Header, beacon: Beacon, rx_ns: int
    ) -> list[tuple[BoardSubscription, RemoteValue]]:
        found: list[tuple[BoardSubscription, RemoteValue]] = []
        hw, clock_us, cache = neighbour.hw, neighbour.clock_us, self.relay_cache
        wants, find = self._subscriptions, self.topology.neighbours.get
        if neighbour.hello is not None:
            is_newest = header.sequence == neighbour.top
            is_settled = rx_ns - neighbour.since_ns > SETTLED_NS
            origin = OriginBeacon(header.sequence, neighbour.window if is_newest else 0, is_settled)
            for value in beacon.values:
                remote = cache.on_own_value(hw, value, clock_us, origin, rx_ns)
                subscription = wants.get((hw, value.data_id))
                if subscription is not None:
                    self._count(subscription, len(value.payload), remote)
                    if remote is not None:
                        found.append((subscription.want, remote))
        for relay in beacon.relays:
            origin_hw = relay.origin_hw
            if origin_hw == self.identity.hw:
                if (false := self._own_claims.on_claim(hw, relay, rx_ns)) is not None:
                    cache.contradictions.append(false)
                continue
            origin_link = find(origin_hw)
            remote = None
            if origin_link is not None and _is_received(origin_link, rx_ns):
                clock_now_us = origin_link.clock_us + (rx_ns - origin_link.received_ns) // 1000
                cache.on_claim(hw, relay, origin_link.top, clock_now_us, rx_ns)
            else:
                remote = cache.on_value(
                    hw,
                    origin_hw,
                    relay.data_id,
                    relay.stamp_us,
                    relay.age_us,
                    relay.hops,
                    relay.packed,
                    relay.payload,
                    rx_ns,
                )
            subscription = wants.get((origin_hw, relay.data_id))
            if subscription is not None:
                self._count(subscription, len(relay.payload), remote)
                if remote is not None:
                    found.append((subscription.want, remote))
        return found

    def _count(self, subscription: _Subscription, size: int, remote: RemoteValue | None) -> None:
        channel = subscription.channel
        if channel is None:
            channel = subscription.channel = self.counters.channel(subscription.want.path)
        channel.received_frames += 1
        channel.received_bytes += size
        if remote is None:
            if self.relay_cache.was_late:
                channel.late += 1
            else:
                channel.duplicates += 1

    def advance(self, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Handles deadlines and expiry; call at each beacon and at `deadline_ns`."""
        self._now_ns = now_ns
        self.channels.advance(now_ns)
        if self.channels.version != self._limits_version:
            self._limits_version = self.channels.version
            self.published.offer(self._plan.offers, self.channels.max_hz)
        if now_ns >= self._forget_ns:
            self._forget_ns = now_ns + _FORGET_NS
            self.relay_cache.forget(now_ns)
            self.nodes.forget(now_ns)
        return self.topology.advance(now_ns)

    def deadline_ns(self) -> int | None:
        """Instant by which `advance` must be called; None: no deadline."""
        return self.topology.deadline_ns()

    def schedule_hello(self) -> None:
        """Adds a hello, with name and session, to the next beacon."""
        self._hello_ns = NEVER_NS

    def forget(self, hw: int, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Removes everything about a node that is not a member any more."""
        self.nodes.remove(hw)
        self.relay_cache.forget_origin(hw)
        return self.topology.exclude(hw, now_ns)

    def drop_subscriptions(self, platforms: Collection[str]) -> None:
        """Ends the subscriptions to the boards of platforms that are not members any more."""
        subscriptions = self._subscriptions.items()
        self._subscriptions = {key: one for key, one in subscriptions if one.want.platform not in platforms}

    def wants(self) -> tuple[BoardSubscription, ...]:
        """The boards that this node subscribes to."""
        return tuple(one.want for one in self._subscriptions.values())

    def board_path(self, origin_hw: int, data_id: int) -> str:
        """Path of a subscribed or own board; its data id where it is neither."""
        if origin_hw == self.identity.hw and (board := self.published.boards.get(data_id)) is not None:
            return board.path
        subscription = self._subscriptions.get((origin_hw, data_id))
        return f"{data_id:08x}" if subscription is None else subscription.want.path

    def set_roster_version(self, version: int) -> None:
        """Sets the version of the roster that hellos show."""
        self._announcements = ROSTER_HELLOS if self._roster_version else 0
        self._roster_version = version

    def may_skip(self, now_ns: int) -> bool:
        """Whether the next beacon may be skipped: it has no change that must be sent now."""
        silence_ns = SILENCE_NS if self._rest_hellos >= REST_HELLOS else FIRST_SILENCE_NS
        if not self.busy or self._hello_ns == NEVER_NS or now_ns - self._sent_ns >= silence_ns:
            return False
        if self._announcements or self.structures.is_due(now_ns):
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
        room -= media_bytes(len(media))
        section = self.topology.compose(now_ns, min(room, OWN_SHARE))
        room -= (
            len(section.echoes) * ECHO_BYTES
            + len(section.rows) * ROW_BYTES
            + len(section.requests) * REQUEST_BYTES
        )
        hz = self.beacon_hz()
        values = self._composed = self.published.values(now_ns, room, round(1e9 / hz))
        room -= sum(value_bytes(value.payload) for value in values)
        for value in values:
            channel = self.counters.channel(self.published.boards[value.data_id].path)
            channel.sent(len(value.payload))
        has_neighbours = self.topology.neighbours.active_count() > 0
        structures = self.structures.compose(now_ns, room, has_neighbours=has_neighbours)
        room -= structures.bytes
        common, needed = self._relay_terms(now_ns)
        members = self.nodes.rows(now_ns, room, common, self.topology.routing.next_hop)
        room -= sum(member_bytes(member) for member in members)
        # the budget of skipped beacons counts too
        span_s = min(max((now_ns - self._sent_ns) / 1e9, 1 / hz), SILENCE_NS / 1e9 + 1 / hz)
        relays = self.relay_cache.compose(
            now_ns, min(room, int(self._relay_bytes_s * span_s)), common, needed
        )
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
        )
        rose = hello is not None and self._declared_period.declare(self._declared_ns, now_ns)
        return OutgoingBeacon(
            self.topology.next_sequence(), hello is not None, beacon, self._declared_period.ns if rose else 0
        )

    def _hello(self, now_ns: int) -> Hello | None:
        slot_ns = round(1e9 / self.beacon_hz())
        rest_ns = -(-SILENCE_NS // slot_ns) * slot_ns
        left_out = self._sent_ns != NEVER_NS and now_ns - self._sent_ns >= FIRST_SILENCE_NS > slot_ns
        rests = self.busy and left_out
        period_ns = rest_ns if rests else max(slot_ns, min(self._gap_ns, rest_ns))
        falls = not self.busy and not self.topology.is_changing(now_ns) and self._quiet_rate.is_falling
        if falls:
            period_ns = max(period_ns, round(1e9 / IDLE_HZ))
        elif self.busy or self.topology.is_changing(now_ns):
            self._quiet_rate.on_change()
        # half a period early: at 10 Hz every tenth, or twentieth, beacon has a hello
        calm = not self.topology.is_changing(now_ns) and now_ns - self._replanned_ns >= HELLO_NS
        again_ns = HELLO_NS if calm else HELLO_CHANGING_NS
        waits = now_ns - self._hello_ns < again_ns - round(0.5e9 / self._busy_hz)
        waits = waits and not self._announcements
        waits = waits and not self.topology.is_new(now_ns)  # until then neighbours may use the former session
        waits = waits and not falls
        waits = waits and not (rests and self._rest_hellos < REST_HELLOS)
        if waits and period_ns <= SLOWER * self._declared_ns:
            return None
        if rests:
            self._rest_hellos += 1
        elif period_ns < rest_ns:
            self._rest_hellos = 0
        if falls:
            self._quiet_rate.on_hello()
        self._hello_ns = now_ns
        self._announcements = max(0, self._announcements - 1)
        self._declared_ns = period_ns
        who = self.identity
        return Hello(
            who.boot_id,
            now_ns // 1000 >> 32,
            self.tcp_port,
            self._plan.tree_version & 0xFFFF_FFFF,
            self._plan.mission & 0xFFFF_FFFF,
            who.kind,
            str(Address(who.platform, who.unit)),
            who.curve_public,
            min(period_ns // 1_000_000, 0xFFFF),
            min(self.topology.neighbours.listing_ns() // 1_000_000, 0xFFFF),
            self.frame_port,
            self._roster_version,
        )

    def sent(self, sequence: int, tx_ns: int, datagram_bytes: int) -> None:
        """Records a sent beacon."""
        self._gap_ns = 0 if self._sent_ns == NEVER_NS else tx_ns - self._sent_ns
        self._sent_ns = tx_ns
        more = datagram_bytes - self._datagram_bytes
        # rises fast, falls slowly: too few beacons are better than too many
        self._datagram_bytes += more / (4 if more > 0 else 16)
        self.topology.sent(sequence, tx_ns)
        self._own_claims.on_sent(self._composed, sequence, tx_ns)


def _is_received(origin: Neighbour, now_ns: int) -> bool:
    """Whether the origin of a relayed value is received itself, so that its own beacons have the value."""
    is_linked = origin.hello is not None and origin.state is not LinkState.DOWN
    return is_linked and now_ns - origin.received_ns <= DIRECT_PERIODS * origin.period_ns
