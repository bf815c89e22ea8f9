"""A neighbour: the record of what is known of a node in range.

All of it is derived from beacons: their sequence numbers measure loss, as Babel's Hello does; their echoes
report what the neighbour received, as IHU (I Heard You) does, with a timestamp. ADR 23 names the tables that
are apart from this record, and why.
"""

import math
from functools import lru_cache
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import NEVER_NS, Hello
from swarmd.broker.core.swarm.links import solicited
from swarmd.broker.core.swarm.links.link import COST_MAX, LinkState, link_cost
from swarmd.broker.core.swarm.media.medium_link import MediumLink

WINDOW: Final = 16
"""Datagrams over which loss is measured: the hello history of Babel (RFC 8966, appendix A.1)."""
_WINDOW_MASK: Final = (1 << WINDOW) - 1
MEASURED: Final = 12
"""Datagrams after which the loss of a direction is known: before, a missing measurement looks like a loss."""
NOTICED: Final = 2
"""Losses among the first datagrams of a neighbour that show a lossy link before it is measured."""
LONG_WINDOW: Final = 64
"""Datagrams over which the loss is measured that the deadline of a link tolerates."""
LONG_MASK: Final = (1 << LONG_WINDOW) - 1
EXPECTED_MIN: Final = 8
"""Minimum of datagrams for a loss: one datagram after a silence does not prove a perfect link."""
PERIODS: Final = 2.5
"""Deadline of a link without loss, in periods: one datagram may be lost."""
FALSE_ALARM: Final = 1e-4
"""Probability of a false alarm, for all neighbours together: consecutive losses that are less likely take a
link down."""
_LOSS_MIN: Final = 0.0075
"""Assumed loss of a link that has lost nothing yet: one datagram in two windows."""
MISSES_MAX: Final = 8
"""Limit of consecutive losses; `notice_ns`, the wait of a restarted node, depends on it."""
LOSSY_RATIO: Final = 1.3
"""Link timeouts of silence that take a link down whose loss allows `MISSES_MAX`: 13 beacons at 10 Hz."""
NOTICE_SLACK_NS: Final = 250_000_000
"""Margin for the delay of a datagram and of a timer."""
_BAD, _BAD_OF = 0.65, 32
"""A link with more loss of at least this many datagrams is taken down early: routes do not wait for it."""
_ERRORS: Final = 1.5
"""Standard errors by which a measured loss may be too low."""
FIRST_PERIOD_NS: Final = 500_000_000
LISTING_NS: Final = 3_000_000_000
"""Every neighbour is listed by an echo within this time."""
LISTINGS: Final = 3
"""Consecutive missed listings that make a link without loss half open."""
UNLISTED_SLACK_NS: Final = 1_000_000_000
HEARS_SLACK_NS: Final = 500_000_000
"""A neighbour's listing of a node is valid for three of its listing periods and this margin."""
CLOCK_HIGH_MAX: Final = 1 << 19
"""Clocks run within 71 years of their zero: in ns, differences of two of them fit into 64 bits."""
_FULL: Final = 255
_HALVES: Final = round(2 * (PERIODS - 2))
"""Half periods beyond the datagrams that may be missed."""
FAR_NS: Final = 1 << 62
"""After every instant."""


class LinkPeer(msgspec.Struct, frozen=True):
    """Endpoint and keys of a neighbour, as frames to it need them."""

    hw: int
    platform: str
    host: str
    """Address of its connections, or "" if no medium to it has connections."""
    port: int
    """TCP port of its connections."""
    curve_public: bytes
    """CURVE key from the roster, or from its hello without a roster, or "" if it is not on the roster."""
    session: int
    frame_port: int = 0
    """UDP port for frames as datagrams, or 0 if it takes none."""


class Neighbour:
    """A node whose datagrams are received, or were within the last minutes."""

    __slots__ = (
        "address",
        "answer_ns",
        "arrived_out",
        "ask_due_ns",
        "asks",
        "asks_needed",
        "best_medium",
        "by_unicast",
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
        "first_listed",
        "hears",
        "hears_badly",
        "hears_well",
        "hello",
        "hw",
        "late",
        "listed_ns",
        "listing_ns",
        "lists_media",
        "lost",
        "media",
        "missed",
        "peer",
        "peer_hello",
        "penalty",
        "period_ns",
        "received",
        "received_ns",
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
        self.state = LinkState.UNKNOWN
        self.since_ns = now_ns
        self.hello: Hello | None = None
        self.address: tuple[str, int] = ("", 0)
        self.session = 0
        self.by_unicast = False
        """The newest datagram came by unicast, so beacons go to this neighbour by unicast, too."""
        self.peer: LinkPeer | None = None
        """Endpoint and keys of its last frames, or None if they are to be derived."""
        self.peer_hello: Hello | None = None
        """Hello from which the endpoint was derived."""
        self.lost = 0
        self.late = 0
        self.hears: dict[int, int] = {}
        """Nodes that it lists as received, and the time of its last listing."""
        self.hears_well: set[int] = set()
        """Nodes that it receives with a quality of at least WELL."""
        self.hears_badly: dict[int, int] = {}
        """Quality of the nodes that it receives with less than WELL."""
        self.media: dict[int, MediumLink] = {}
        """Links by number of their medium, on a node with several media."""
        self.restart(now_ns)

    def restart(self, now_ns: int) -> None:
        """Drops the state of the former session."""
        self.hello = None
        self.clock_us = 0
        self.hears.clear()
        self.hears_well.clear()
        self.hears_badly.clear()
        self.media.clear()
        self.lists_media = False
        """The neighbour lists the media by which it receives nodes, so it has several."""
        self.best_medium: int | None = None
        """Number of the medium of its packets, or None if no medium works in both directions."""
        self.penalty = 0
        """Cost that the rate of its medium adds."""
        self.period_ns = FIRST_PERIOD_NS
        self.listing_ns = LISTING_NS
        self.answer_ns = 0
        """Time in which it answers a request for a beacon, or 0 if it is not known to answer."""
        self.revive(now_ns)

    def revive(self, now_ns: int) -> None:
        """Resets the measurements of the link, after a long silence."""
        self.top = 0
        self.window = 0
        self.cost_inputs = (0, 0, 0, 0)
        """Inputs of the last computed cost."""
        self.compared_cost = COST_MAX
        """Cost of the link at the last comparison of routes over it."""
        self.missed = 0
        """Datagrams that are overdue since the last one."""
        self.expected = 0
        self.received = 0
        self.received_ns = now_ns
        self.deadline_ns = now_ns
        self.asks = self.asks_needed = 0
        """Requests for a beacon since its last datagram, and how many without an answer end the link."""
        self.ask_due_ns = FAR_NS
        """When the next request is due, or after the last one the end of the link; FAR_NS: none."""
        self.listed_ns = NEVER_NS
        self.reported = self.arrived_out = _FULL
        self.first_listed = -1
        """Own beacon that its first listing answered, or -1 before that."""
        self.rtt_ns = 0
        self.echoed_ns = NEVER_NS
        self.echoed_quality = 0
        self.echo_reverse_us = 0
        self.echo_sequence = -1
        self.echo_rx_ns = 0
        self.withdrawals = 0

    @property
    def best_link(self) -> MediumLink | None:
        """The link over the medium of its packets, on a node with several media."""
        return None if self.best_medium is None else self.media.get(self.best_medium)

    def is_new(self, sequence: int) -> bool:
        """Whether a beacon of its session was not received yet over any medium.

        The window of the loss has as many numbers as the replay window of the seals: an older one is refused.
        """
        ahead = sequence - self.top
        return ahead > 0 or (ahead > -LONG_WINDOW and not self.window >> -ahead & 1)

    @property
    def quality(self) -> int:
        """Share of its last datagrams that arrived, in 1/255."""
        # computed for each neighbour in each beacon
        if self.window & _WINDOW_MASK == _WINDOW_MASK and not self.missed:
            return _FULL  # the common case
        expected = max(EXPECTED_MIN, min(WINDOW, self.expected + self.missed))
        received = (self.window << self.missed & _WINDOW_MASK).bit_count()
        return min(round(_FULL * received / expected), _FULL)

    def on_reported(self, quality: int, sequence: int) -> None:
        """Takes the share of our datagrams that it receives, from a listing that answers our beacon of this
        number.

        The listing counts late datagrams as lost. The better of two reports is the loss on the way, because a
        datagram that is late in one of them has arrived in the other.
        """
        if self.first_listed < 0:
            self.first_listed = sequence
        # its loss is measured; before, the first listings count beacons that it could not receive
        if sequence - self.first_listed >= MEASURED:
            self.arrived_out = max(self.reported, quality)
        self.reported = quality

    @property
    def wire_loss(self) -> float | None:
        """Share of datagrams that were lost on the way, in the worse direction, or None if not measured.

        A datagram that a busy processor sends or receives late does not count as lost.
        """
        expected = min(WINDOW, self.expected)
        lost = expected - (self.window & (1 << expected) - 1).bit_count()
        # a few datagrams prove a lossy link, but no clean one
        if self.expected < MEASURED:
            return lost / expected if lost >= NOTICED else None
        return max(lost / expected, 1 - self.arrived_out / _FULL)

    @property
    def quality_out(self) -> int:
        """Share of own datagrams that it reports as received, in 1/255, or 0 unless the link is up."""
        return self.reported if self.state is LinkState.UP else 0

    @property
    def cost(self) -> int:
        """Cost of the link: loss of both directions, round trip, and rate of its medium."""
        return link_cost(self.quality, self.reported, self.penalty, self.rtt_ns)

    def misses(self, neighbours: int) -> int:
        """Consecutive losses after which the link is down, for a number of neighbours."""
        if self.hello is None:
            return 2
        # the common case, without a logarithm
        if self.window == LONG_MASK:
            return _misses(_LOSS_MIN, neighbours)
        # it is of no use to routes; two losses in a row are enough to give it up
        if self._long_loss() >= _BAD:
            return 2
        return _misses(self._loss_bound(), neighbours)

    def _long_loss(self) -> float:
        expected = min(LONG_WINDOW, self.expected)
        return (expected - self.window.bit_count()) / max(_BAD_OF, expected)

    def _loss_bound(self) -> float:
        """Loss of the long window alone, and its error: a link whose loss rose lately may be leaving its
        range."""
        long_loss = self._long_loss()
        error = _ERRORS * math.sqrt(long_loss * (1.0 - long_loss) / LONG_WINDOW)
        return max(long_loss + error, _LOSS_MIN)

    def expect(self, neighbours: int, link_timeout_ns: int) -> None:
        """Sets the deadline of the link after a datagram, and when the next one counts as overdue.

        A neighbour is asked only where that is sooner than to wait for a number of its beacons.
        """
        misses, period_ns = self.misses(neighbours), self.period_ns
        timeout_ns = link_timeout_ns if misses < MISSES_MAX else round(LOSSY_RATIO * link_timeout_ns)
        periods_ns = (2 * misses + _HALVES) * period_ns // 2
        self.deadline_ns = self.received_ns + max(timeout_ns, periods_ns)
        self.asks, self.ask_due_ns = 0, FAR_NS
        # below the link timeout nothing is gained by a question
        if periods_ns > timeout_ns and self.answer_ns and self.state is LinkState.UP:
            silence_ns = solicited.silence_ns(
                solicited.overdue_beacons(min(self._long_loss(), _BAD), neighbours), period_ns
            )
            asking_ns = (solicited.ASKS_MIN - 1) * self._ask_again_ns() + self._answered_ns()
            if silence_ns + asking_ns < periods_ns:
                self.ask_due_ns = self.received_ns + silence_ns

    def on_asked(self, now_ns: int, neighbours: int, link_timeout_ns: int) -> None:
        """A beacon that asks it is sent."""
        self.asks += 1
        # the number of requests follows from what is missing now, and stays while it is asked
        if self.asks == 1:
            beacons = max((now_ns - self.received_ns) // self.period_ns, 1)
            loss_out = max(1.0 - self.reported / _FULL, _LOSS_MIN)
            self.asks_needed = solicited.asks(self._loss_bound(), loss_out, beacons, FALSE_ALARM / neighbours)
        if self.asks < self.asks_needed:
            self.ask_due_ns = now_ns + self._ask_again_ns()
        else:
            self.ask_due_ns = max(now_ns + self._answered_ns(), self.received_ns + link_timeout_ns)

    def is_silent(self, now_ns: int) -> bool:
        """Whether the link is down, because its deadline has passed or requests were not answered."""
        return now_ns >= self.deadline_ns or (now_ns >= self.ask_due_ns and 0 < self.asks_needed <= self.asks)

    def _ask_again_ns(self) -> int:
        return max(solicited.ASK_AGAIN_NS, self.answer_ns)

    def _answered_ns(self) -> int:
        return self.answer_ns + self.rtt_ns + solicited.ANSWER_SLACK_NS

    def hears_until_ns(self, hw: int) -> int:
        """Until when its listing of a node is valid."""
        return self.hears.get(hw, NEVER_NS) + LISTINGS * self.listing_ns + HEARS_SLACK_NS


def notice_ns(period_ns: int, timeout_ns: int) -> int:
    """Time without a datagram after which every neighbour has taken the link down, whatever its loss.

    `period_ns`: the longest period between two datagrams that the node declared.
    """
    periods_ns = round((MISSES_MAX + PERIODS - 2) * period_ns)
    first_ns = round(PERIODS * FIRST_PERIOD_NS)
    return max(round(LOSSY_RATIO * timeout_ns), first_ns, periods_ns) + NOTICE_SLACK_NS


@lru_cache(maxsize=1024)
def _misses(loss: float, neighbours: int) -> int:
    misses = math.ceil(math.log(FALSE_ALARM / neighbours) / math.log(loss))
    return min(max(misses, 2), MISSES_MAX)
