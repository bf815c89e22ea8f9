"""One node's side of the tick: what a datagram means, and what the next one says."""

from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.core.bulletin import Bulletin
from swarmd.broker.core.channel import Channels
from swarmd.broker.core.directory import HYSTERESIS, RouteChanged
from swarmd.broker.core.members import Members, wire_name
from swarmd.broker.core.mesh import LinkChanged, LinkState, Mesh, Timing
from swarmd.broker.core.neighbour import CLOCK_HIGH_MAX, PERFECT, Neighbour
from swarmd.broker.core.pace import IDLE_HZ, LEAST_HZ, QUICK_HZ, Slowdown, allowed_hz
from swarmd.broker.core.relay import News, Relays
from swarmd.broker.core.slowest import Slowest
from swarmd.broker.core.tick import (
    BODY_LIMIT,
    ECHO_BYTES,
    NEVER_NS,
    REQUEST_BYTES,
    ROW_BYTES,
    Header,
    Hello,
    PlatformKind,
    Tick,
    hello_bytes,
    member_bytes,
    value_bytes,
)
from swarmd.broker.core.traffic import IP_UDP_BYTES, Channel, Counters
from swarmware.names import hardware_id
from swarmware.types.net import TreePlan, Want

HELLO_NS: Final = 2_000_000_000
"""Names are repeated this often."""
HELLO_CHANGING_NS: Final = 1_000_000_000
"""The same while links come and go, because others will come into range, and once after another tree or
mission."""
SILENCE_NS: Final = 430_000_000
"""A node whose boards stand still ticks in the first slot after this time: at 10 Hz every half second, as one
of which nobody wants anything."""
FIRST_SILENCE_NS: Final = 350_000_000
"""As long as neighbours may not know of it: they may miss one datagram of a node that they expect more of."""
REST_HELLOS: Final = 3
"""Hellos in a row that declare the longer time: one may be lost."""
OWN_SHARE: Final = 700
"""Bytes of a datagram's body that echoes, rows and own boards may take together before relays and
names get their turn; a board that is larger than what is left waits for a datagram of its own."""
SETTLE_NS: Final = 15_000_000_000
"""No tick is left out for so long after a link came or went: a new clock is measured with all of them."""
DIRECT_COST: Final = 2 * PERFECT - HYSTERESIS - PERFECT // 2
"""Two hops cost two perfect links at least, and a node leaves them for one that is better by more than the
hysteresis; half a link more, because both ends judge it from samples of their own: they may differ by two
datagrams of sixteen."""
DIRECT_NS: Final = 5_000_000_000
"""By then both ends have judged the link from the same datagrams, and chosen their ways."""
SLOWER: Final = 1.25
"""A time between datagrams that grew by this factor is declared at once: others would take us for gone."""
_FORGET_NS: Final = 10_000_000_000
_FIRST_DATAGRAM_BYTES: Final = 150.0


class Identity(msgspec.Struct, frozen=True):
    """Who this node is."""

    hw: int
    platform: str
    unit: str
    kind: PlatformKind
    boot_id: int
    curve_public: bytes
    """Empty where the roster has it."""


class _Wanted:
    """A board that somebody here reads."""

    __slots__ = ("channel", "want")

    def __init__(self, want: Want) -> None:
        self.want = want
        self.channel: Channel | None = None
        """Its counters, once there is something to count."""


class Arrival(msgspec.Struct, frozen=True, gc=False):
    """What one datagram brought."""

    neighbour: Neighbour
    timing: Timing | None
    links: list[LinkChanged]
    routes: list[RouteChanged]
    news: list[tuple[Want, News]]
    """Values that somebody here reads."""
    stranger: bool
    """Says its name for the first time, or anew: answer soon, so that it learns ours."""


class Departure(msgspec.Struct, frozen=True, gc=False):
    """The next datagram."""

    sequence: int
    with_session: bool
    tick: Tick
    slowest_ns: int = 0
    """To be kept before it leaves: how slow our neighbours take us to be; 0: nothing new."""


class Station:
    """Neighbours, routes, names, own and relayed boards of one node."""

    def __init__(
        self,
        identity: Identity,
        mesh: Mesh,
        counters: Counters,
        *,
        busy_hz: float,
        relay_bytes_s: float,
        slowest: Slowest | None = None,
    ) -> None:
        self.identity = identity
        self.mesh = mesh
        self.counters = counters
        self.channels = Channels()
        self.members = Members(identity.hw)
        self.bulletin = Bulletin()
        self.relays = Relays()
        self.slowdown = Slowdown()
        self.tcp_port = 0
        self.reserved_bytes = 0
        """Of the next body, for what is put into it after it was composed."""
        self._busy_hz = busy_hz
        self._relay_bytes_s = relay_bytes_s
        self._plan = TreePlan(0)
        self._limits_version = 0
        self._wants: dict[tuple[int, int], _Wanted] = {}
        """By origin and data id."""
        self._hello_ns = NEVER_NS
        self._replanned_ns = NEVER_NS
        """When tree or mission, which the hello names, changed last."""
        self._forget_ns = NEVER_NS
        self._sent_ns = NEVER_NS
        self._now_ns = NEVER_NS
        self._gap_ns = 0
        """Time between our last two datagrams."""
        self._slowest = slowest or Slowest(0, NEVER_NS)
        self._declared_ns = 0
        """What the last hello said of the time between two."""
        self._rest_hellos = 0
        """Hellos in a row that declared the time between two ticks of a node at rest."""
        self._relaying = False
        self._datagram_bytes = _FIRST_DATAGRAM_BYTES

    # what is wanted

    def set_plan(self, plan: TreePlan) -> list[tuple[Want, News]]:
        """What the tick shall carry from now on; values already heard of boards that are wanted now."""
        if plan.tree_version != self._plan.tree_version or plan.mission != self._plan.mission:
            self._hello_ns = NEVER_NS
            self._replanned_ns = self._now_ns
        self._plan = plan
        self.bulletin.offer(plan.offers, self.channels.max_hz)
        wants = {(hardware_id(want.platform, want.unit), want.data_id): _Wanted(want) for want in plan.wants}
        heard: list[tuple[Want, News]] = []
        for key, wanted in wants.items():
            if key not in self._wants and (news := self.relays.newest(*key)) is not None:
                heard.append((wanted.want, news))
        self._wants = wants
        return heard

    @property
    def busy(self) -> bool:
        """Somebody wants something periodic from here, or somebody else's boards pass through."""
        return bool(self.bulletin.boards) or self._relaying

    def tick_hz(self) -> float:
        """Ticks per second at present."""
        if self.busy or self.mesh.is_new(self._now_ns):
            wanted_hz = self._busy_hz
        else:
            wanted_hz = min(QUICK_HZ if self.mesh.is_changing(self._now_ns) else IDLE_HZ, self._busy_hz)
        return max(min(wanted_hz, self.allowed_hz()) / self.slowdown.factor, LEAST_HZ)

    def allowed_hz(self) -> float:
        """Most datagrams per second that the air has room for."""
        heard = self.mesh.neighbours.heard_count()
        return allowed_hz(heard, self._datagram_bytes + IP_UDP_BYTES)

    # what comes in

    def on_datagram(self, header: Header, tick: Tick, address: tuple[str, int], rx_ns: int) -> Arrival | None:
        """A datagram that was opened. None: it says what cannot be, or there is no room for its sender."""
        hw = header.sender_hw
        if hw in (0, self.identity.hw):
            self.counters.refused.malformed += 1
            return None
        known = self.mesh.neighbours.get(hw)
        restarted = False
        if header.session is not None and known is not None:
            restarted = known.session not in (0, header.session)
        stranger = False
        if tick.hello is not None:
            clock_fits = abs(tick.hello.clock_high) <= CLOCK_HIGH_MAX
            if not clock_fits or not self.members.on_hello(hw, tick.hello, rx_ns):
                self.counters.refused.malformed += 1
                return None
            stranger = known is None or known.hello is None or restarted
        heard = self.mesh.on_tick(header, tick, restarted, address, rx_ns)
        if heard is None:
            self.counters.refused.no_room += 1
            return None
        neighbour = heard.neighbour
        if header.session is not None:
            neighbour.session = header.session
        if restarted:
            self.relays.restart(hw)
        directory = self.mesh.directory
        for row in tick.members:
            # the newest tree is known by the next hop to it; a name proves itself, whoever says it
            if row.hw != self.identity.hw and (
                directory.next_hop(row.hw) in (hw, 0) or self.members.get(row.hw) is None
            ):
                self.members.on_row(row, rx_ns)
        if stranger:
            self.members.repeat()
        news = self._read(neighbour, tick, rx_ns) if tick.values or tick.relays else []
        return Arrival(neighbour, heard.timing, heard.links, heard.routes, news, stranger)

    def _read(self, neighbour: Neighbour, tick: Tick, rx_ns: int) -> list[tuple[Want, News]]:
        found: list[tuple[Want, News]] = []
        hw, clock_us = neighbour.hw, neighbour.clock_us
        on_value, wants = self.relays.on_value, self._wants
        if neighbour.hello is not None:
            for value in tick.values:
                age_us, data_id = value.age_us, value.data_id
                news = on_value(
                    hw, hw, data_id, clock_us - age_us, age_us, 1, value.packed, value.payload, rx_ns
                )
                wanted = wants.get((hw, data_id))
                if wanted is not None:
                    self._count(wanted, len(value.payload), news)
                    if news is not None:
                        found.append((wanted.want, news))
        for relay in tick.relays:
            origin_hw = relay.origin_hw
            if origin_hw == self.identity.hw:
                continue
            news = on_value(
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
            wanted = wants.get((origin_hw, relay.data_id))
            if wanted is not None:
                self._count(wanted, len(relay.payload), news)
                if news is not None:
                    found.append((wanted.want, news))
        return found

    def _count(self, wanted: _Wanted, size: int, news: News | None) -> None:
        channel = wanted.channel
        if channel is None:
            channel = wanted.channel = self.counters.channel(wanted.want.path)
        channel.received_frames += 1
        channel.received_bytes += size
        if news is None:
            if self.relays.was_late:
                channel.late += 1
            else:
                channel.duplicates += 1

    def on_timer(self, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Deadlines, ages; call at each tick and at `deadline_ns`."""
        self._now_ns = now_ns
        self.channels.on_timer(now_ns)
        if self.channels.version != self._limits_version:
            self._limits_version = self.channels.version
            self.bulletin.offer(self._plan.offers, self.channels.max_hz)
        if now_ns >= self._forget_ns:
            self._forget_ns = now_ns + _FORGET_NS
            self.relays.forget(now_ns)
            self.members.forget(now_ns)
        return self.mesh.on_timer(now_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has to be called at the latest."""
        return self.mesh.deadline_ns()

    # what goes out

    def say_hello(self) -> None:
        """The next datagram carries name and session."""
        self._hello_ns = NEVER_NS

    def is_idle(self, now_ns: int) -> bool:
        """Whether this tick would say nothing that cannot wait: boards that stand still need none."""
        silence_ns = SILENCE_NS if self._rest_hellos >= REST_HELLOS else FIRST_SILENCE_NS
        if not self.busy or self._hello_ns == NEVER_NS or now_ns - self._sent_ns >= silence_ns:
            return False
        if self.mesh.is_changing(now_ns, SETTLE_NS):
            return False
        if self.bulletin.has_news(now_ns, round(1e9 / self.tick_hz()), SILENCE_NS):
            return False
        return not self.relays.has_news(now_ns, *self._relay_terms(now_ns))

    def _relay_terms(self, now_ns: int) -> tuple[frozenset[int], Callable[[int, set[int]], bool]]:
        """Nodes that all neighbours hear, and whether some neighbour needs a value of another one."""
        neighbours = self.mesh.neighbours
        return neighbours.common(now_ns), lambda origin_hw, have: neighbours.needed(origin_hw, have, now_ns)

    def compose(self, now_ns: int) -> Departure:
        """The next datagram, the parts in the order of their importance."""
        hello = self._hello(now_ns)
        room = BODY_LIMIT - 16 - self.reserved_bytes - (hello_bytes(hello) if hello is not None else 0)
        shape = self.mesh.compose(now_ns, min(room, OWN_SHARE))
        room -= (
            len(shape.echoes) * ECHO_BYTES + len(shape.rows) * ROW_BYTES + len(shape.requests) * REQUEST_BYTES
        )
        hz = self.tick_hz()
        values = self.bulletin.values(now_ns, room, round(1e9 / hz))
        room -= sum(value_bytes(value.payload) for value in values)
        for value in values:
            channel = self.counters.channel(self.bulletin.boards[value.data_id].path)
            channel.sent(len(value.payload))
        common, needed = self._relay_terms(now_ns)
        members = self.members.rows(now_ns, room, common, self.mesh.directory.next_hop)
        room -= sum(member_bytes(member) for member in members)
        # the budget of the slots that were left out counts too
        span_s = min(max((now_ns - self._sent_ns) / 1e9, 1 / hz), SILENCE_NS / 1e9 + 1 / hz)
        relays = self.relays.compose(now_ns, min(room, int(self._relay_bytes_s * span_s)), common, needed)
        self._relaying = bool(relays) or (self._relaying and self.relays.recently(now_ns))
        tick = Tick(
            hello, shape.echoes, shape.rows, shape.requests, tuple(members), tuple(values), tuple(relays)
        )
        rose = hello is not None and self._slowest.declare(self._declared_ns, now_ns)
        return Departure(self.mesh.next_sequence(), hello is not None, tick, self._slowest.ns if rose else 0)

    def _hello(self, now_ns: int) -> Hello | None:
        slot_ns = round(1e9 / self.tick_hz())
        rest_ns = -(-SILENCE_NS // slot_ns) * slot_ns
        left_out = self._sent_ns != NEVER_NS and now_ns - self._sent_ns >= FIRST_SILENCE_NS > slot_ns
        rests = self.busy and left_out
        period_ns = rest_ns if rests else max(slot_ns, min(self._gap_ns, rest_ns))
        # half a tick early rather than a tick late: at 10 Hz every tenth, or twentieth, datagram has it
        calm = not self.mesh.is_changing(now_ns) and now_ns - self._replanned_ns >= HELLO_NS
        again_ns = HELLO_NS if calm else HELLO_CHANGING_NS
        waits = now_ns - self._hello_ns < again_ns - round(0.5e9 / self._busy_hz)
        waits = waits and not self.mesh.is_new(now_ns)  # until then nobody sends to us again
        waits = waits and not (rests and self._rest_hellos < REST_HELLOS)
        if waits and period_ns <= SLOWER * self._declared_ns:
            return None
        if rests:
            self._rest_hellos += 1
        elif period_ns < rest_ns:
            self._rest_hellos = 0
        self._hello_ns = now_ns
        self._declared_ns = period_ns
        who = self.identity
        return Hello(
            who.boot_id,
            now_ns // 1000 >> 32,
            self.tcp_port,
            self._plan.tree_version & 0xFFFF_FFFF,
            self._plan.mission & 0xFFFF_FFFF,
            who.kind,
            wire_name(who.platform, who.unit),
            who.curve_public,
            min(period_ns // 1_000_000, 0xFFFF),
            min(self.mesh.neighbours.listing_ns() // 1_000_000, 0xFFFF),
        )

    def sent(self, sequence: int, tx_ns: int, datagram_bytes: int) -> None:
        """The datagram left."""
        self._gap_ns = 0 if self._sent_ns == NEVER_NS else tx_ns - self._sent_ns
        self._sent_ns = tx_ns
        more = datagram_bytes - self._datagram_bytes
        self._datagram_bytes += more / (4 if more > 0 else 16)  # sooner too few datagrams than too many
        self.mesh.sent(sequence, tx_ns)

    def next_hop(self, hw: int) -> int:
        """Neighbour that leads to a node; 0: none."""
        return self.mesh.directory.next_hop(hw)

    def is_up(self, hw: int) -> bool:
        """Whether both directions to a neighbour work."""
        neighbour = self.mesh.neighbours.get(hw)
        return neighbour is not None and neighbour.state is LinkState.UP

    def is_direct(self, hw: int, now_ns: int) -> bool:
        """Whether a node surely sends to us itself: every way over another one would cost it more.

        Not in the first seconds: until then it may still use the way that it had before.
        """
        neighbour = self.mesh.neighbours.get(hw)
        return (
            neighbour is not None
            and neighbour.state is LinkState.UP
            and neighbour.cost <= DIRECT_COST
            and now_ns - neighbour.since_ns >= DIRECT_NS
        )
