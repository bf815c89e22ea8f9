"""The neighbour table: all neighbours of a node, the echoes that list them, the deadlines of their links."""

from typing import Final

from swarmd.broker.core.beacon.beacon import ANSWERED_SEQUENCES, NEVER_NS, NO_ECHO, Echo, Header, Hello
from swarmd.broker.core.beacon.parts.solicitation import ASKED_MAX
from swarmd.broker.core.swarm.clock_batches import ClockSample
from swarmd.broker.core.swarm.links.link import (
    RECEIVED,
    TRANSITIONS,
    LinkChanged,
    LinkEvent,
    LinkState,
    link_cost,
)
from swarmd.broker.core.swarm.neighbour import (
    CLOCK_HIGH_MAX,
    FAR_NS,
    FIRST_PERIOD_NS,
    HEARS_SLACK_NS,
    LISTING_NS,
    LISTINGS,
    LONG_MASK,
    LONG_WINDOW,
    UNLISTED_SLACK_NS,
    WINDOW,
    Neighbour,
)
from swarmd.broker.core.swarm.routes.destination_routes import is_much_worse

_PERIOD_MAX_NS: Final = 10_000_000_000
LISTING_EACH_NS: Final = 50_000_000
"""Share of each neighbour in the listing period, where there are many."""
FIRST_LISTINGS: Final = 6
"""Echoes in the first listing period after a change of the link: one of them brings the other end up."""
_LISTED_NS: Final = LISTINGS * LISTING_NS + UNLISTED_SLACK_NS
"""A link listed within this time counts as bidirectional, whatever its loss."""
QUALITY_STEP: Final = 64
QUALITY_NS: Final = 500_000_000
"""A quality that changed by that step is reported after this time: the neighbour's cost depends on it."""
ECHO_GAP_NS: Final = 200_000_000
"""Echoes beyond the listing: five a second in all, to the neighbour that waited longest."""
ANSWER_LIMIT_NS: Final = 25_000_000_000
"""Oldest own datagram that an echo can answer: 256 beacons at 10 Hz."""
_SLACK_NS: Final = 10_000_000
"""Margin for the drift of two clocks during the hold time of an echo."""
WELL: Final = 180
"""Quality, in 1/255, from which what a node relays counts as received: seven of ten datagrams."""
WITHDRAWALS: Final = 2
"""Echoes of quality 0 that report a lost neighbour as not received."""
FORGET_NS: Final = 600_000_000_000
NEIGHBOUR_LIMIT: Final = 1024
_CLOCK_MAX_US: Final = CLOCK_HIGH_MAX << 32
_MOD32: Final = 0xFFFF_FFFF
_FULL: Final = 255


class NeighbourTable:
    """All neighbours of a node, their echoes and deadlines."""

    def __init__(self, own_hw: int, link_timeout_ns: int) -> None:
        self.own_hw = own_hw
        self._timeout_ns = link_timeout_ns
        self._all: dict[int, Neighbour] = {}
        self._sent: list[tuple[int, int]] = [(-1, 0)] * ANSWERED_SEQUENCES
        self._echoed_ns = NEVER_NS
        self._common: frozenset[int] = frozenset()
        self._linked: frozenset[int] = frozenset()
        self._common_ns = NEVER_NS
        self._active = 0
        """Number of neighbours whose link is not down."""
        self._usual_ns: int | None = None  # until a period or a link changes
        self._to_ask: set[int] = set()
        """Neighbours that the next beacon asks for one."""
        self._is_asking = False
        self.again_ns = FAR_NS
        """When `advance` is due for the neighbours that the last beacons asked; FAR_NS: for none."""

    def get(self, hw: int) -> Neighbour | None:
        """Neighbour of this hardware id in any state, or None for an unknown node."""
        return self._all.get(hw)

    def all(self) -> list[Neighbour]:
        """All nodes received within the last minutes."""
        return list(self._all.values())

    def up(self) -> list[Neighbour]:
        """Neighbours whose link is bidirectional."""
        return [n for n in self._all.values() if n.state is LinkState.UP]

    def listing_ns(self) -> int:
        """Period in which every neighbour gets an echo, if there is room."""
        return max(LISTING_NS, self.active_count() * LISTING_EACH_NS)

    def usual_period_ns(self) -> int:
        """Median of the periods that the received nodes declare."""
        if self._usual_ns is None:
            all_ns = sorted(one.period_ns for one in self._all.values() if one.state is not LinkState.DOWN)
            self._usual_ns = all_ns[len(all_ns) // 2] if all_ns else FIRST_PERIOD_NS
        return self._usual_ns

    def active_count(self) -> int:
        """Number of nodes in range, which share the channel."""
        return self._active

    def on_header(
        self,
        header: Header,
        restarted: bool,
        address: tuple[str, int],
        rx_ns: int,
        changes: list[LinkChanged],
    ) -> Neighbour | None:
        """Takes the header of an authenticated datagram. None: the neighbour table is full."""
        neighbour = self._all.get(header.sender_hw)
        if neighbour is None:
            if len(self._all) >= NEIGHBOUR_LIMIT:
                return None
            neighbour = self._all[header.sender_hw] = Neighbour(header.sender_hw, rx_ns)
            self._common_ns = NEVER_NS
        elif restarted:
            self._event(neighbour, LinkEvent.RESTARTED, rx_ns, changes)
            # after the event, which reports until when the former session worked
            neighbour.restart(rx_ns)
            self._usual_ns = None
        # measurements from before the silence say nothing about the link that has just appeared
        if neighbour.state in (LinkState.UNKNOWN, LinkState.DOWN):
            neighbour.revive(rx_ns)
            self._event(neighbour, LinkEvent.BEACON, rx_ns, changes)
        neighbour.address = address
        neighbour.received_ns = rx_ns
        neighbour.received += 1
        self._count(neighbour, header)
        neighbour.missed = 0
        neighbour.expect(len(self._all), self._timeout_ns)
        self._to_ask.discard(neighbour.hw)
        return neighbour

    def on_hello(self, neighbour: Neighbour, header: Header, hello: Hello) -> None:
        """Takes its name, the upper half of its clock, and its declared periods."""
        neighbour.hello, self._usual_ns = hello, None
        neighbour.period_ns = min(max(hello.period_ms, 1) * 1_000_000, _PERIOD_MAX_NS)
        neighbour.listing_ns = max(hello.listing_ms, 1) * 1_000_000
        neighbour.clock_us = hello.clock_high << 32 | header.tx_us
        # the next beacon comes after the period that this one declares
        neighbour.expect(len(self._all), self._timeout_ns)

    def on_echoes(
        self,
        neighbour: Neighbour,
        header: Header,
        echoes: tuple[Echo, ...],
        rx_ns: int,
        changes: list[LinkChanged],
    ) -> ClockSample | None:
        """Takes its listings of received nodes; returns a clock sample where the datagram gives one."""
        forward_ns: int | None = None
        forward_tx_ns = 0
        # headers have the low 32 bits of the clock; the hello has the upper part
        clock_us = neighbour.clock_us
        known = neighbour.hello is not None
        if known:
            step = (header.tx_us - clock_us) & _MOD32
            clock_us += step if step < 1 << 31 else step - (1 << 32)
            neighbour.clock_us = clock_us
            if abs(clock_us) > _CLOCK_MAX_US:
                neighbour.hello = None  # beyond the range of clocks: wait for the next hello
                known = False
        hears, hears_well, hears_badly = neighbour.hears, neighbour.hears_well, neighbour.hears_badly
        for hw, sequence, hold_us, quality in echoes:
            # a listing with quality 0 withdraws an earlier one
            if quality:
                hears[hw] = rx_ns
            else:
                hears.pop(hw, None)
            if quality >= WELL:
                hears_well.add(hw)
                hears_badly.pop(hw, None)
            else:
                hears_well.discard(hw)
                hears_badly[hw] = quality
            if hw != self.own_hw:
                continue
            # the neighbour says that it does not receive this node any more; no need to wait for silence
            if not quality:
                self._event(neighbour, LinkEvent.UNLISTED, rx_ns, changes)
                neighbour.listed_ns = NEVER_NS
                continue
            if hold_us == NO_ECHO:
                # It received nothing since its last listing. That keeps a link up, but cannot bring it
                # up: it may refer to our former session, whose routes it still uses.
                if neighbour.state is LinkState.UP:
                    neighbour.listed_ns = rx_ns
                    neighbour.reported = quality
                continue
            # an echo of another session, or of a beacon that is too old, proves nothing about the link now
            sent_sequence, sent_ns = self._sent[sequence]
            if sent_sequence < 0 or not hold_us * 1000 - _SLACK_NS <= rx_ns - sent_ns <= ANSWER_LIMIT_NS:
                continue
            neighbour.listed_ns = rx_ns
            neighbour.on_reported(quality, sent_sequence)
            self._event(neighbour, LinkEvent.LISTED, rx_ns, changes)
            if known:
                forward_ns = (clock_us - hold_us) * 1000 - sent_ns
                forward_tx_ns = sent_ns
        reverse_us = clock_us - rx_ns // 1000
        # the datagram with the smallest delay since the last echo gives the best clock sample
        if neighbour.echo_sequence < 0 or reverse_us > neighbour.echo_reverse_us:
            neighbour.echo_reverse_us = reverse_us
            neighbour.echo_sequence = header.sequence
            neighbour.echo_rx_ns = rx_ns
        if neighbour.hello is None:
            return None
        reverse_ns = clock_us * 1000 - rx_ns
        if forward_ns is not None:
            # both clock differences have the same offset, so their difference is the round trip
            rtt_ns = max(forward_ns - reverse_ns, 0)
            neighbour.rtt_ns += (rtt_ns - neighbour.rtt_ns) // 8 if neighbour.rtt_ns else rtt_ns
        return ClockSample(
            neighbour.hw, neighbour.hello.boot_id, rx_ns, reverse_ns, forward_ns, forward_tx_ns
        )

    def needed(self, origin_hw: int, have: set[int], now_ns: int) -> bool:
        """Whether some neighbour neither receives the origin itself, nor has the value or receives a node
        that sent it."""
        return any(
            neighbour.state is LinkState.UP
            and neighbour.hw not in have
            and neighbour.hears_well.isdisjoint(have)
            and neighbour.hears_until_ns(origin_hw) < now_ns
            for neighbour in self._all.values()
        )

    def advance(self, now_ns: int) -> list[LinkChanged]:
        """Takes links down whose deadline has passed, and counts overdue datagrams."""
        changes = list[LinkChanged]()
        # one answer may be pending for several neighbours; their own instants are checked below
        if now_ns >= self.again_ns:
            self.again_ns = FAR_NS  # those that are due later count in `deadline_ns`
        for neighbour in self.all():  # a copy: expired ones are removed
            if neighbour.state is LinkState.DOWN:
                if now_ns - neighbour.received_ns > FORGET_NS:
                    self._event(neighbour, LinkEvent.EXPIRED, now_ns, changes)
            elif neighbour.is_silent(now_ns):
                self._to_ask.discard(neighbour.hw)
                # announced in the next beacons, so that the other end does not wait for missing echoes
                neighbour.withdrawals = WITHDRAWALS
                self._event(neighbour, LinkEvent.SILENT, now_ns, changes)
            else:
                if now_ns >= neighbour.ask_due_ns:
                    neighbour.ask_due_ns = FAR_NS
                    self._to_ask.add(neighbour.hw)
                    self._is_asking = True
                period_ns = neighbour.period_ns
                late_ns = now_ns - neighbour.received_ns - period_ns // 2
                neighbour.missed = 0 if late_ns < period_ns else min(late_ns // period_ns, WINDOW)
                if now_ns - max(neighbour.listed_ns, neighbour.since_ns) > _LISTED_NS:
                    self._look_for_listing(neighbour, now_ns, changes)
        return changes

    def _look_for_listing(self, neighbour: Neighbour, now_ns: int, changes: list[LinkChanged]) -> None:
        listings = max(LISTINGS, neighbour.misses(len(self._all)))
        silent_ns = now_ns - max(neighbour.listed_ns, neighbour.since_ns)
        if silent_ns > listings * max(neighbour.listing_ns, LISTING_NS) + UNLISTED_SLACK_NS:
            self._event(neighbour, LinkEvent.UNLISTED, now_ns, changes)

    def deadline_ns(self) -> int | None:
        """Instant by which `advance` must be called, or None without a deadline."""
        return min(
            (min(n.deadline_ns, n.ask_due_ns) for n in self._all.values() if n.state is not LinkState.DOWN),
            default=None,
        )

    def take_asking(self) -> bool:
        """Whether neighbours became overdue since the last call: the next beacon asks them, soon."""
        is_asking, self._is_asking = self._is_asking, False
        return is_asking

    def asked(self, now_ns: int) -> tuple[int, ...]:
        """Overdue neighbours that the beacon composed now asks for one; it is sent."""
        if not self._to_ask:
            return ()
        asked = sorted(self._to_ask)[:ASKED_MAX]
        self._to_ask.difference_update(asked)
        for hw in asked:
            neighbour = self._all[hw]
            neighbour.on_asked(now_ns, len(self._all), self._timeout_ns)
            self.again_ns = min(self.again_ns, neighbour.ask_due_ns)
        return tuple(asked)

    def sent(self, sequence: int, tx_ns: int) -> None:
        """Records the send time of a datagram, for the echoes that answer it."""
        self._sent[sequence & 0xFF] = (sequence, tx_ns)

    def echoes(self, now_ns: int, room: int, listing_ns: int) -> tuple[Echo, ...]:
        """Echoes for the next beacon: neighbours not listed for `listing_ns`, the longest waiting first.

        Each echo answers the datagram with the smallest delay since the last echo, which the estimator of
        the other side would select.
        """
        due: list[Neighbour] = []
        longest: Neighbour | None = None
        out: list[Echo] = []
        for neighbour in self._all.values():
            if neighbour.state is LinkState.DOWN:
                # lost neighbours come first; the other end still uses the link
                if neighbour.withdrawals and len(out) < room:
                    neighbour.withdrawals -= 1
                    out.append(Echo(neighbour.hw, 0, NO_ECHO, 0))
                continue
            period_ns = listing_ns
            # a link that has just changed is listed more often; each listing brings the other end up
            if now_ns - neighbour.since_ns < listing_ns:
                period_ns //= FIRST_LISTINGS
            elif abs(neighbour.quality - neighbour.echoed_quality) >= QUALITY_STEP:
                period_ns = min(listing_ns, QUALITY_NS)
            if now_ns - neighbour.echoed_ns >= period_ns:
                due.append(neighbour)
            elif longest is None or neighbour.echoed_ns < longest.echoed_ns:
                longest = neighbour
        # between listings single echoes follow, because clocks need samples in both directions
        if not due and longest is not None and now_ns - self._echoed_ns >= ECHO_GAP_NS:
            due.append(longest)
        if len(out) + len(due) > room:
            # the longest waiting neighbours first, so that none is starved in a dense cell
            due.sort(key=lambda neighbour: neighbour.echoed_ns)
            del due[room - len(out) :]
        for neighbour in due:
            self._echoed_ns = neighbour.echoed_ns = now_ns
            neighbour.echoed_quality = neighbour.quality
            hold_us = (now_ns - neighbour.echo_rx_ns) // 1000
            # nothing new to answer; the echo only lists the neighbour as received
            if neighbour.echo_sequence < 0 or not 0 <= hold_us < NO_ECHO:
                out.append(Echo(neighbour.hw, 0, NO_ECHO, max(neighbour.quality, 1)))
                continue
            out.append(Echo(neighbour.hw, neighbour.echo_sequence & 0xFF, hold_us, max(neighbour.quality, 1)))
            neighbour.echo_sequence = -1
        return tuple(out)

    def common(self, now_ns: int, refresh_ns: int = 1_000_000_000) -> frozenset[int]:
        """Nodes that every neighbour receives directly or is itself: their values need no relay."""
        # quadratic in the neighbours, so computed once a second, and when a link goes up or down
        if now_ns - self._common_ns >= refresh_ns:
            self._common_ns = now_ns
            received_by: dict[int, set[int]] = {}
            for neighbour in self.up():
                oldest_ns = now_ns - LISTINGS * neighbour.listing_ns - HEARS_SLACK_NS
                hears = {hw for hw, reported_ns in neighbour.hears.items() if reported_ns >= oldest_ns}
                neighbour.hears_well &= hears
                for hw in neighbour.hears_badly.keys() - hears:
                    del neighbour.hears_badly[hw]
                hears.add(neighbour.hw)
                received_by[neighbour.hw] = hears
            common = set.intersection(*received_by.values()) - {self.own_hw} if received_by else set[int]()
            self._common = frozenset(common)
            linked = {hw for hw in common if hw in received_by and received_by.keys() <= received_by[hw]}
            self._linked = frozenset(linked - self._badly_linked(linked))
        return self._common

    def linked(self, now_ns: int) -> frozenset[int]:
        """Common nodes that receive every neighbour in turn: routes to them need no advertisement, unless one
        over this node is much better than such a link."""
        self.common(now_ns)
        return self._linked

    def _badly_linked(self, linked: set[int]) -> set[int]:
        """Linked nodes whose link to another linked node costs much more than over this node."""
        found: set[int] = set()
        for neighbour in self.up():
            for hw, quality in neighbour.hears_badly.items():
                if hw not in linked or {hw, neighbour.hw} <= found:
                    continue
                other = self._all[hw]
                direct = link_cost(quality, other.hears_badly.get(neighbour.hw, _FULL), 0, 0)
                if is_much_worse(direct, neighbour.cost + other.cost):
                    found |= {hw, neighbour.hw}
        return found

    def _count(self, neighbour: Neighbour, header: Header) -> None:
        # overtaken on the way; it was counted as lost when the later one arrived
        ahead = header.sequence - neighbour.top
        if ahead <= 0:
            neighbour.late += 1
            behind = -ahead
            if behind < neighbour.expected:
                neighbour.lost -= 1
            elif behind < LONG_WINDOW:
                neighbour.lost += behind - neighbour.expected  # overtaken by the first one received
                neighbour.expected = behind + 1
            if behind < LONG_WINDOW:
                neighbour.window |= 1 << behind
            return
        if neighbour.expected == 0 or ahead > LONG_WINDOW:
            # the first one, or the sender jumped (a higher sequence number was requested)
            neighbour.expected += 1
            neighbour.window = (neighbour.window << 1 | 1) & LONG_MASK
        else:
            neighbour.expected += ahead
            neighbour.lost += ahead - 1
            neighbour.window = (neighbour.window << ahead | 1) & LONG_MASK
        neighbour.top = header.sequence

    def _event(self, neighbour: Neighbour, event: LinkEvent, now_ns: int, changes: list[LinkChanged]) -> None:
        after = TRANSITIONS.get((neighbour.state, event))
        if after is None:
            return
        before, neighbour.state = neighbour.state, after
        if after is LinkState.FORGOTTEN:
            del self._all[neighbour.hw]  # the link does not change: it has been down for minutes
            return
        worked_ns = neighbour.listed_ns if event is LinkEvent.UNLISTED else neighbour.received_ns
        changes.append(LinkChanged(neighbour.hw, before, after, event, worked_ns))
        if LinkState.UP in (after, before):
            self._common_ns = NEVER_NS
        self._active += (after in RECEIVED) - (before in RECEIVED)
        neighbour.since_ns = now_ns
        self._usual_ns = None
