"""Neighbours: who is heard, who hears us, how well, and what their clocks showed.

Everything is read off the beacons themselves: their sequence numbers are hello and loss
meter, their echoes say that we are heard, how well, and when.
"""

import math
from functools import lru_cache
from typing import Final

from swarmd.broker.core.beacon import ANSWERED_SEQUENCES, NEVER_NS, NO_ECHO, Echo, Header, Hello
from swarmd.broker.core.clock_sample import ClockSample
from swarmd.broker.core.link import TRANSITIONS, LinkChanged, LinkEvent, LinkState

WINDOW: Final = 16
"""Datagrams over which loss is judged: the hello history of Babel (RFC 8966, appendix A.1)."""
_WINDOW_MASK: Final = (1 << WINDOW) - 1
LONG_WINDOW: Final = 64
"""Datagrams over which the loss is judged that a link's deadline has to bear."""
_LONG_MASK: Final = (1 << LONG_WINDOW) - 1
EXPECTED_MIN: Final = 8
"""Loss is judged over so many at least: one datagram after a silence is no proof of a perfect link."""
PERFECT: Final = 256
"""Cost of a link without loss."""
COST_MAX: Final = 8192
PERIODS: Final = 2.5
"""A sender without loss may miss one datagram before its silence counts."""
_HALVES: Final = round(2 * (PERIODS - 2))
"""Half periods beyond the datagrams that may be missed."""
FALSE_ALARM: Final = 1e-4
"""Silence counts when so many datagrams in a row are less likely to be lost than this, divided by the
number of neighbours."""
_LOSS_MIN: Final = 0.0075
"""Loss of a link that has lost nothing yet: one datagram in two windows."""
MISSES_MAX: Final = 8
"""What a node that starts again waits for counts on that: `notice_ns`."""
NOTICE_SLACK_NS: Final = 250_000_000
"""A datagram may be under way for so long, and a timer be late."""
_BAD: Final = 0.5
"""A link with more loss is given up early: routes had better not wait for it."""
FIRST_PERIOD_NS: Final = 500_000_000
_PERIOD_MAX_NS: Final = 10_000_000_000
LISTING_NS: Final = 3_000_000_000
"""Everybody heard is listed at least this often."""
LISTING_EACH_NS: Final = 50_000_000
"""The same among many: so much time for each."""
LISTINGS: Final = 3
"""Missed one after the other, they take a link without loss down to half open."""
UNLISTED_SLACK_NS: Final = 1_000_000_000
_LISTED_NS: Final = LISTINGS * LISTING_NS + UNLISTED_SLACK_NS
"""Listed within this time, a link is taken for one in both directions, whatever its loss."""
HEARS_SLACK_NS: Final = 500_000_000
"""A neighbour's word that it hears somebody holds for three of its listings and this."""
QUALITY_STEP: Final = 64
QUALITY_NS: Final = 500_000_000
"""A quality that changed by that step is said after this time: the other side's cost depends on it."""
ECHO_GAP_NS: Final = 200_000_000
"""Echoes beyond the listing: at least five a second in all, to whoever waited longest."""
ANSWER_LIMIT_NS: Final = 25_000_000_000
"""Oldest datagram of ours that an echo can mean: 256 beacons at 10 Hz."""
_SLACK_NS: Final = 10_000_000
"""Two clocks may drift this much apart while an echo is held back."""
WITHDRAWALS: Final = 2
"""How often a lost neighbour is told that we do not hear it."""
FORGET_NS: Final = 600_000_000_000
NEIGHBOUR_LIMIT: Final = 1024
CLOCK_HIGH_MAX: Final = 1 << 19
"""Clocks run within 71 years of their zero: in ns, differences of two of them fit into 64 bits."""
_CLOCK_MAX_US: Final = CLOCK_HIGH_MAX << 32
_FULL: Final = 255
_MOD32: Final = 0xFFFF_FFFF


class Neighbour:
    """One node that we hear, or heard not long ago."""

    __slots__ = (
        "address",
        "clock_us",
        "compared_cost",
        "cost_inputs",
        "deadline_ns",
        "echo_reverse_us",
        "echo_rx_ns",
        "echo_sequence",
        "echoed_ns",
        "echoed_quality",
        "expected",
        "heard_ns",
        "hears",
        "hello",
        "hw",
        "late",
        "listed_ns",
        "listing_ns",
        "lost",
        "missed",
        "period_ns",
        "received",
        "reported",
        "rtt_ns",
        "session",
        "since_ns",
        "state",
        "top",
        "window",
        "withdrawals",
    )

    def __init__(self, hw: int, now_ns: int) -> None:
        self.hw = hw
        self.state = LinkState.DOWN
        self.since_ns = now_ns
        self.hello: Hello | None = None
        self.address: tuple[str, int] = ("", 0)
        self.session = 0
        self.lost = 0
        self.late = 0
        self.hears: dict[int, int] = {}
        """Nodes that it lists as heard, and when it said so last."""
        self.restart(now_ns)

    def restart(self, now_ns: int) -> None:
        """Forgets what belonged to its former session."""
        self.hello = None
        self.clock_us = 0
        self.hears.clear()
        self.period_ns = FIRST_PERIOD_NS
        self.listing_ns = LISTING_NS
        self.revive(now_ns)

    def revive(self, now_ns: int) -> None:
        """Forgets what was measured on the link: it was silent for long."""
        self.top = 0
        self.window = 0
        self.cost_inputs = (0, 0, 0)
        """What the cost was last made of."""
        self.compared_cost = COST_MAX
        """Its cost when routes over it were compared last."""
        self.missed = 0
        """Datagrams that should have come since the last one."""
        self.expected = 0
        self.received = 0
        self.heard_ns = now_ns
        self.deadline_ns = now_ns
        self.listed_ns = NEVER_NS
        self.reported = _FULL
        self.rtt_ns = 0
        self.echoed_ns = NEVER_NS
        self.echoed_quality = 0
        self.echo_reverse_us = 0
        self.echo_sequence = -1
        self.echo_rx_ns = 0
        self.withdrawals = 0

    @property
    def quality(self) -> int:
        """Share of its last datagrams that arrived, in 1/255."""
        if self.window & _WINDOW_MASK == _WINDOW_MASK and not self.missed:
            return _FULL  # most links, most of the time
        expected = max(EXPECTED_MIN, min(WINDOW, self.expected + self.missed))
        received = (self.window << self.missed & _WINDOW_MASK).bit_count()
        return min(round(_FULL * received / expected), _FULL)

    @property
    def cost(self) -> int:
        """Square of the expected transmissions, in 1/256: loss of both directions.

        The square keeps routes off links at the edge of their range, which end before a swarm that moves has
        turned its routes: of 100 nodes at 10 m/s 99.8 % of the pairs have their route, with the plain number
        99.2 %, for fewer bytes (test_routes_at_speed).
        """
        both = self.quality * self.reported
        return min(PERFECT * _FULL**4 // both**2, COST_MAX) if both else COST_MAX

    def misses(self, neighbours: int) -> int:
        """How many datagrams in a row that do not come mean that none will, among so many neighbours."""
        if self.hello is None:
            return 2
        if self.window == _LONG_MASK:
            return _misses(_LOSS_MIN, neighbours)
        lost = min(LONG_WINDOW, self.expected) - self.window.bit_count()
        long_loss = lost / max(WINDOW, min(LONG_WINDOW, self.expected))
        if long_loss >= _BAD:
            return 2
        lately = min(WINDOW, self.expected) - (self.window & _WINDOW_MASK).bit_count()
        return _misses(min(max(long_loss, lately / WINDOW, _LOSS_MIN), _BAD), neighbours)

    def hears_until_ns(self, hw: int) -> int:
        """Until when its word holds that it hears this node."""
        said_ns = self.hears.get(hw, NEVER_NS)
        return said_ns + LISTINGS * self.listing_ns + HEARS_SLACK_NS


def notice_ns(period_ns: int, timeout_ns: int) -> int:
    """After so long without a datagram everybody has taken the link to a node down, whatever its loss.

    `period_ns`: the longest time between two of its datagrams that it declared.
    """
    periods_ns = round((MISSES_MAX + PERIODS - 2) * period_ns)
    first_ns = round(PERIODS * FIRST_PERIOD_NS)
    return max(timeout_ns, first_ns, periods_ns) + NOTICE_SLACK_NS


class NeighbourTable:
    """All neighbours of one node."""

    def __init__(self, own_hw: int, link_timeout_ns: int) -> None:
        self.own_hw = own_hw
        self._timeout_ns = link_timeout_ns
        self._all: dict[int, Neighbour] = {}
        self._sent: list[tuple[int, int]] = [(-1, 0)] * ANSWERED_SEQUENCES
        self._echoed_ns = NEVER_NS
        self._common: frozenset[int] = frozenset()
        self._linked: frozenset[int] = frozenset()
        self._common_ns = NEVER_NS
        self._heard = 0
        """Neighbours that are not down."""

    def get(self, hw: int) -> Neighbour | None:
        """A neighbour, whatever its state."""
        return self._all.get(hw)

    def all(self) -> list[Neighbour]:
        """Everybody heard within the last minutes."""
        return list(self._all.values())

    def up(self) -> list[Neighbour]:
        """Those with whom both directions work."""
        return [n for n in self._all.values() if n.state is LinkState.UP]

    def listing_ns(self) -> int:
        """Everybody heard gets an echo this often, with room for it."""
        return max(LISTING_NS, self.heard_count() * LISTING_EACH_NS)

    def usual_period_ns(self) -> int:
        """Between two datagrams of a node: half of those that are heard declare a shorter one."""
        periods_ns = sorted(one.period_ns for one in self._all.values() if one.state is not LinkState.DOWN)
        return periods_ns[len(periods_ns) // 2] if periods_ns else FIRST_PERIOD_NS

    def heard_count(self) -> int:
        """Nodes that share the air with us."""
        return self._heard

    # what comes in

    def on_header(
        self,
        header: Header,
        restarted: bool,
        address: tuple[str, int],
        rx_ns: int,
        changes: list[LinkChanged],
    ) -> Neighbour | None:
        """A datagram that was opened. None: no room for another neighbour."""
        neighbour = self._all.get(header.sender_hw)
        if neighbour is None:
            if len(self._all) >= NEIGHBOUR_LIMIT:
                return None
            neighbour = self._all[header.sender_hw] = Neighbour(header.sender_hw, rx_ns)
            self._common_ns = NEVER_NS
        elif restarted:
            self._event(neighbour, LinkEvent.RESTARTED, rx_ns, changes)
            neighbour.restart(rx_ns)
        if neighbour.state is LinkState.DOWN:
            neighbour.revive(rx_ns)
            self._event(neighbour, LinkEvent.DATAGRAM, rx_ns, changes)
        neighbour.address = address
        neighbour.heard_ns = rx_ns
        neighbour.received += 1
        self._count(neighbour, header)
        neighbour.missed = 0
        half_periods = 2 * neighbour.misses(len(self._all)) + _HALVES
        neighbour.deadline_ns = rx_ns + max(self._timeout_ns, half_periods * neighbour.period_ns // 2)
        return neighbour

    def on_hello(self, neighbour: Neighbour, header: Header, hello: Hello) -> None:
        """Its name, the upper half of its clock, and how often it speaks."""
        neighbour.hello = hello
        neighbour.period_ns = min(max(hello.period_ms, 1) * 1_000_000, _PERIOD_MAX_NS)
        neighbour.listing_ns = max(hello.listing_ms, 1) * 1_000_000
        neighbour.clock_us = hello.clock_high << 32 | header.tx_us

    def on_echoes(
        self,
        neighbour: Neighbour,
        header: Header,
        echoes: tuple[Echo, ...],
        rx_ns: int,
        changes: list[LinkChanged],
    ) -> ClockSample | None:
        """Whom it hears, and the time differences when this datagram can give them."""
        forward_ns: int | None = None
        forward_tx_ns = 0
        clock_us = neighbour.clock_us
        known = neighbour.hello is not None
        if known:
            step = (header.tx_us - clock_us) & _MOD32
            clock_us += step if step < 1 << 31 else step - (1 << 32)
            neighbour.clock_us = clock_us
            if abs(clock_us) > _CLOCK_MAX_US:
                neighbour.hello = None  # its steps led where no clock runs: the next hello tells
                known = False
        hears = neighbour.hears
        for hw, sequence, hold_us, quality in echoes:
            if quality:
                hears[hw] = rx_ns
            else:
                hears.pop(hw, None)
            if hw != self.own_hw:
                continue
            if not quality:
                neighbour.listed_ns = NEVER_NS
                self._event(neighbour, LinkEvent.UNLISTED, rx_ns, changes)
                continue
            if hold_us == NO_ECHO:
                # Heard nothing of us since it last listed us. That keeps a link up, but cannot bring
                # it up: it may mean our former session, whose routes it would still believe in.
                if neighbour.state is LinkState.UP:
                    neighbour.listed_ns = rx_ns
                    neighbour.reported = quality
                continue
            sent_sequence, sent_ns = self._sent[sequence]
            if sent_sequence < 0 or not hold_us * 1000 - _SLACK_NS <= rx_ns - sent_ns <= ANSWER_LIMIT_NS:
                continue
            neighbour.listed_ns = rx_ns
            neighbour.reported = quality
            self._event(neighbour, LinkEvent.LISTED, rx_ns, changes)
            if known:
                forward_ns = (clock_us - hold_us) * 1000 - sent_ns
                forward_tx_ns = sent_ns
        reverse_us = clock_us - rx_ns // 1000
        if neighbour.echo_sequence < 0 or reverse_us > neighbour.echo_reverse_us:
            neighbour.echo_reverse_us = reverse_us
            neighbour.echo_sequence = header.sequence
            neighbour.echo_rx_ns = rx_ns
        if neighbour.hello is None:
            return None
        reverse_ns = clock_us * 1000 - rx_ns
        if forward_ns is not None:
            rtt_ns = max(forward_ns - reverse_ns, 0)
            neighbour.rtt_ns += (rtt_ns - neighbour.rtt_ns) // 8 if neighbour.rtt_ns else rtt_ns
        return ClockSample(
            neighbour.hw, neighbour.hello.boot_id, rx_ns, reverse_ns, forward_ns, forward_tx_ns
        )

    def needed(self, origin_hw: int, have: set[int], now_ns: int) -> bool:
        """Whether a neighbour neither hears this node itself nor is one of those who have its value."""
        return any(
            neighbour.state is LinkState.UP
            and neighbour.hw not in have
            and neighbour.hears_until_ns(origin_hw) < now_ns
            for neighbour in self._all.values()
        )

    def on_timer(self, now_ns: int) -> list[LinkChanged]:
        """Deadlines that passed."""
        changes: list[LinkChanged] = []
        forgotten: list[int] = []
        for neighbour in self._all.values():
            if neighbour.state is LinkState.DOWN:
                if now_ns - neighbour.heard_ns > FORGET_NS:
                    forgotten.append(neighbour.hw)
            elif now_ns >= neighbour.deadline_ns:
                neighbour.withdrawals = WITHDRAWALS
                self._event(neighbour, LinkEvent.SILENT, now_ns, changes)
            else:
                period_ns = neighbour.period_ns
                late_ns = now_ns - neighbour.heard_ns - period_ns // 2
                neighbour.missed = 0 if late_ns < period_ns else min(late_ns // period_ns, WINDOW)
                if now_ns - max(neighbour.listed_ns, neighbour.since_ns) > _LISTED_NS:
                    self._look_for_listing(neighbour, now_ns, changes)
        for hw in forgotten:
            del self._all[hw]
        return changes

    def _look_for_listing(self, neighbour: Neighbour, now_ns: int, changes: list[LinkChanged]) -> None:
        listings = max(LISTINGS, neighbour.misses(len(self._all)))
        silent_ns = now_ns - max(neighbour.listed_ns, neighbour.since_ns)
        if silent_ns > listings * max(neighbour.listing_ns, LISTING_NS) + UNLISTED_SLACK_NS:
            self._event(neighbour, LinkEvent.UNLISTED, now_ns, changes)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has to be called at the latest."""
        return min((n.deadline_ns for n in self._all.values() if n.state is not LinkState.DOWN), default=None)

    # what goes out

    def sent(self, sequence: int, tx_ns: int) -> None:
        """A datagram left with this stamp; echoes will name it."""
        self._sent[sequence & 0xFF] = (sequence, tx_ns)

    def echoes(self, now_ns: int, room: int, listing_ns: int) -> tuple[Echo, ...]:
        """Echoes for the next datagram: whoever was not listed for `listing_ns`, new ones first.

        Each answers the datagram that came with the least delay since the last echo: the one the
        estimators of the other side would keep.
        """
        due: list[Neighbour] = []
        longest: Neighbour | None = None
        out: list[Echo] = []
        for neighbour in self._all.values():
            if neighbour.state is LinkState.DOWN:
                if neighbour.withdrawals and len(out) < room:
                    neighbour.withdrawals -= 1
                    out.append(Echo(neighbour.hw, 0, NO_ECHO, 0))
            elif now_ns - neighbour.echoed_ns >= (
                listing_ns
                if abs(neighbour.quality - neighbour.echoed_quality) < QUALITY_STEP
                else min(listing_ns, QUALITY_NS)
            ):
                due.append(neighbour)
            elif longest is None or neighbour.echoed_ns < longest.echoed_ns:
                longest = neighbour
        if not due and longest is not None and now_ns - self._echoed_ns >= ECHO_GAP_NS:
            due.append(longest)
        if len(out) + len(due) > room:
            due.sort(key=lambda neighbour: neighbour.echoed_ns)
            del due[room - len(out) :]
        if due:
            self._echoed_ns = now_ns
        for neighbour in due:
            neighbour.echoed_ns = now_ns
            neighbour.echoed_quality = neighbour.quality
            hold_us = (now_ns - neighbour.echo_rx_ns) // 1000
            if neighbour.echo_sequence < 0 or not 0 <= hold_us < NO_ECHO:
                out.append(Echo(neighbour.hw, 0, NO_ECHO, max(neighbour.quality, 1)))
                continue
            out.append(Echo(neighbour.hw, neighbour.echo_sequence & 0xFF, hold_us, max(neighbour.quality, 1)))
            neighbour.echo_sequence = -1
        return tuple(out)

    def common(self, now_ns: int, refresh_ns: int = 1_000_000_000) -> frozenset[int]:
        """Nodes that every neighbour of ours hears itself (or is): nobody needs their values from us."""
        if now_ns - self._common_ns >= refresh_ns:
            self._common_ns = now_ns
            heard: dict[int, set[int]] = {}
            for neighbour in self.up():
                oldest_ns = now_ns - LISTINGS * neighbour.listing_ns - HEARS_SLACK_NS
                hears = {hw for hw, said_ns in neighbour.hears.items() if said_ns >= oldest_ns}
                hears.add(neighbour.hw)
                heard[neighbour.hw] = hears
            common = set.intersection(*heard.values()) - {self.own_hw} if heard else set[int]()
            self._common = frozenset(common)
            self._linked = frozenset(hw for hw in common if hw in heard and heard.keys() <= heard[hw])
        return self._common

    def linked(self, now_ns: int) -> frozenset[int]:
        """Common nodes that hear every neighbour of ours in turn: nobody needs our routes to them."""
        self.common(now_ns)
        return self._linked

    # how a datagram is counted

    def _count(self, neighbour: Neighbour, header: Header) -> None:
        ahead = header.sequence - neighbour.top
        if ahead <= 0:
            neighbour.late += 1
            behind = -ahead
            if behind < neighbour.expected:
                neighbour.lost -= 1
            elif behind < LONG_WINDOW:
                neighbour.lost += behind - neighbour.expected  # overtaken by the first one we got
                neighbour.expected = behind + 1
            if behind < LONG_WINDOW:
                neighbour.window |= 1 << behind
            return
        if neighbour.expected == 0 or ahead > LONG_WINDOW:
            # the first one, or the sender jumped (it was asked for a higher sequence number)
            neighbour.expected += 1
            neighbour.window = (neighbour.window << 1 | 1) & _LONG_MASK
        else:
            neighbour.expected += ahead
            neighbour.lost += ahead - 1
            neighbour.window = (neighbour.window << ahead | 1) & _LONG_MASK
        neighbour.top = header.sequence

    def _event(self, neighbour: Neighbour, event: LinkEvent, now_ns: int, changes: list[LinkChanged]) -> None:
        after = TRANSITIONS.get((neighbour.state, event))
        if after is None:
            return
        changes.append(LinkChanged(neighbour.hw, neighbour.state, after, event))
        if LinkState.UP in (after, neighbour.state):
            self._common_ns = NEVER_NS
        self._heard += (after is not LinkState.DOWN) - (neighbour.state is not LinkState.DOWN)
        neighbour.state = after
        neighbour.since_ns = now_ns


@lru_cache(maxsize=1024)
def _misses(loss: float, neighbours: int) -> int:
    misses = math.ceil(math.log(FALSE_ALARM / neighbours) / math.log(loss))
    return min(max(misses, 2), MISSES_MAX)
