"""Streams whose rate follows their link: what is sent of them when it falls, recovers, loses, or is cut."""

import heapq
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import pytest

from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.lane import COALESCE_NS, LaneNumber, NotificationLane
from swarmd.tree.core.notification.link_rate import STOPPED_NS, UNLIMITED_BIT_S, LinkRate
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import RATE_MAX_HZ, ChannelSettings
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem, TreeNotify

MS = 1_000_000
S = 1000 * MS
SCAN = Resource(path="map/scan", kind=Kind.STREAM, type="Blob")
EVENT = Resource(path="health/faults", kind=Kind.EVENT, type="Text")
BOARD = Resource(path="power/battery", type="Blob")
AUTO = ChannelSettings(RATE_MAX_HZ, adaptive=True)
BYTES = 1000
WAY_NS = 5 * MS


def item(sequence: int, stamp_ns: int, size: int = BYTES) -> TreeItem:
    return TreeItem(
        "map/scan", 7, FrameKind.STREAM, sequence, stamp_ns, sequence.to_bytes(8) + bytes(size - 8)
    )


class Arrival(NamedTuple):
    at_ns: int
    sequence: int
    age_ns: int


class Link:
    """A lane over a link with a rate and a queue, as the broker before it is one."""

    def __init__(self, feed: Feed, bit_s: Callable[[int], float]) -> None:
        self.feed = feed
        self.arrived: list[Arrival] = []
        self._bit_s = bit_s
        self._lane = NotificationLane(LaneNumber.STREAMS)
        self._free_ns = 0
        self._acks: list[tuple[int, int]] = []

    def run(self, period_ns: int, until_ns: int, begin_ns: int = 0, first: int = 0, size: int = BYTES) -> int:
        """Writes an item in each period; the number of the next."""
        sequence, write_ns, step_ns = first, begin_ns, 5 * MS
        for now_ns in range(begin_ns, until_ns, step_ns):
            while self._acks and self._acks[0][0] <= now_ns:
                at_ns, serial = heapq.heappop(self._acks)
                self._lane.delivered(serial, at_ns)
                self._send_due(now_ns)
            while write_ns <= now_ns:
                self.feed.offer(item(sequence, write_ns, size))
                sequence, write_ns = sequence + 1, write_ns + period_ns
            self._send_due(now_ns)
        return sequence

    def _send_due(self, now_ns: int) -> None:
        while self._may_send(now_ns):
            self._send(now_ns)

    def _may_send(self, now_ns: int) -> bool:
        due_ns = self.feed.due_ns() if self._lane.has_room() else None
        if due_ns is None:
            return False
        return now_ns >= (max(due_ns, self._lane.sent_ns + COALESCE_NS) if self._lane else due_ns)

    def _send(self, now_ns: int) -> None:
        items = self.feed.take(now_ns, 32, 32 * 1024)
        notify = TreeNotify("uav1", 1, 0, tuple(items))
        serial = self._lane.send(notify, [(self.feed, items)], now_ns).serial
        begin_ns = max(now_ns, self._free_ns)
        if not self._bit_s(begin_ns):
            return  # cut: it is neither delivered nor, yet, failed
        self._free_ns = begin_ns + round(sum(len(one.data) for one in items) * 8e9 / self._bit_s(begin_ns))
        at_ns = self._free_ns + WAY_NS
        self.arrived += [Arrival(at_ns, one.sequence, at_ns - one.stamp_ns) for one in items]
        heapq.heappush(self._acks, (at_ns + WAY_NS, serial))

    def within(self, begin_s: float, end_s: float) -> list[Arrival]:
        return [one for one in self.arrived if begin_s * S <= one.at_ns < end_s * S]


def adaptive(resource: Resource = SCAN) -> Feed:
    feed = Feed(resource, Rule("**"), 0)
    feed.set_channel(AUTO)
    return feed


def fall(now_ns: int) -> float:
    """5 Mbit/s, of which 0.5 are left between 5 and 15 s."""
    return 0.5e6 if 5 * S <= now_ns < 15 * S else 5e6


def test_stream_on_failing_link_stays_young_and_recovers() -> None:
    link = Link(adaptive(), fall)
    written = link.run(5 * MS, 22 * S)  # 1.6 Mbit/s
    before, slow, after = link.within(1, 5), link.within(6, 15), link.within(19, 22)
    assert len(before) == pytest.approx(800, abs=10)
    assert len(after) == pytest.approx(600, abs=10)
    assert len(slow) * BYTES * 8 / 9 > 0.75 * 0.5e6, "most of what the link carries is used"
    assert max(one.age_ns for one in link.within(5, 6)) < 400 * MS
    assert max(one.age_ns for one in slow) < 250 * MS
    assert max(one.age_ns for one in before + after) < 60 * MS
    sequences = [one.sequence for one in link.arrived]
    assert sequences == sorted(set(sequences)), "in order, none twice"
    waiting, _ = link.feed.waiting
    assert link.feed.held_back + len(sequences) + waiting == written, "each is sent or counted"
    assert link.feed.lost == 0


def test_stream_without_link_rate_waits_in_full() -> None:
    link = Link(Feed(SCAN, Rule("**"), 0), fall)
    link.run(5 * MS, 12 * S)
    assert max(one.age_ns for one in link.within(8, 12)) > 2 * S
    assert (link.feed.held_back, link.feed.pace(12 * S)) == (0, (None, ""))


def test_rate_and_reason_are_shown_until_set() -> None:
    link = Link(adaptive(), fall)
    following = link.run(5 * MS, 4 * S)
    assert link.feed.pace(4 * S) == (None, "the link carries all")
    following = link.run(5 * MS, 12 * S, 4 * S, following)
    rate_hz, reason = link.feed.pace(12 * S)
    assert rate_hz == pytest.approx(62.5, rel=0.4)
    assert reason == "free" or reason.startswith("queue of ")
    link.feed.set_channel(ChannelSettings(5.0))
    assert link.feed.pace(12 * S) == (5.0, "set")
    assert link.feed.link_rate is None
    link.run(5 * MS, 14 * S, 12 * S, following)
    assert len(link.within(12.5, 14)) == pytest.approx(7, abs=1)


def test_link_limited_items_leave_at_equal_distances() -> None:
    link = Link(adaptive(), lambda _: 0.5e6)
    link.run(5 * MS, 10 * S)
    stamps = [one.at_ns - one.age_ns for one in link.within(4, 10)]
    gaps_ms = [(after - before) / MS for before, after in pairwise(stamps)]
    assert sum(gap <= 40 for gap in gaps_ms) > 0.9 * len(gaps_ms), "a period of the link is 16 ms"


def test_group_of_items_is_sent_whole() -> None:
    link = Link(adaptive(), lambda _: 5e6)
    following = 0
    for second in range(10):
        for _ in range(10):
            link.feed.offer(item(following, second * S))
            following += 1
        following = link.run(S, (second + 1) * S, second * S, following)
    assert link.feed.held_back == 0
    assert len(link.arrived) == following


def test_stream_continues_with_new_after_cut() -> None:
    rate = LinkRate()
    under_way = []
    for number in range(500):
        now_ns = number * 10 * MS
        if rate.admits(item(number, now_ns), None):
            rate.on_sent([item(number, now_ns)], now_ns)
            if number < 50:
                rate.on_acknowledged([item(number, now_ns)], None, now_ns + 4 * MS)
            else:
                under_way.append(number)
    assert under_way[:11] == list(range(50, 61)), "a tenth of a second, until the cut is seen"
    assert len(under_way[11:]) == 4, "then one in a second"
    assert all(not rate.admits(item(number, number * 10 * MS), 600 * MS) for number in range(500, 900)), (
        "none while one waits"
    )
    assert STOPPED_NS == S
    for number in under_way:
        rate.on_acknowledged([item(number, 0)], None, 9 * S)
    sent = 0
    for number in range(900, 1800):
        now_ns = number * 10 * MS
        if rate.admits(item(number, now_ns), None):
            rate.on_sent([item(number, now_ns)], now_ns)
            rate.on_acknowledged([item(number, now_ns)], None, now_ns + 4 * MS)
            sent += 1
    assert not rate.is_limited
    assert rate.rate_hz is None
    assert sent > 550, "the last six of nine seconds whole"


def test_single_late_acknowledgements_do_not_lower_the_rate() -> None:
    rate = LinkRate()
    for number in range(1000):
        now_ns = number * 20 * MS
        assert rate.admits(item(number, now_ns), None)
        rate.on_sent([item(number, now_ns)], now_ns)
        delay_ns = (90 if number % 4 == 0 else 8) * MS
        rate.on_acknowledged([item(number, now_ns)], None, now_ns + delay_ns)
    assert not rate.is_limited


def test_longer_way_counts_as_queue_only_temporarily() -> None:
    rate = LinkRate()
    for number in range(4000):
        now_ns = number * 10 * MS
        if rate.admits(item(number, now_ns), None):
            rate.on_sent([item(number, now_ns)], now_ns)
            rate.on_acknowledged([item(number, now_ns)], None, now_ns + (8 if number < 500 else 90) * MS)
        if number == 700:
            assert rate.is_limited
    assert not rate.is_limited


def test_clock_set_back_does_not_silence_stream() -> None:
    link = Link(adaptive(), lambda _: 0.5e6)
    following = link.run(5 * MS, 1100 * S, 1095 * S)
    now_ns = 5 * S
    admitted = [
        number
        for number in range(following, following + 400)
        if link.feed.link_rate is not None
        and link.feed.link_rate.admits(item(number, now_ns + (number - following) * 5 * MS), None)
    ]
    assert len(admitted) > 50


def test_newest_waiting_item_is_kept_at_start() -> None:
    feed = Feed(SCAN, Rule("**"), 0)
    for number in range(50):
        feed.offer(item(number, number * MS))
    feed.set_channel(AUTO)
    assert (feed.waiting, feed.held_back) == ((1, BYTES), 49)
    assert [one.sequence for one in feed.take(S, 32, 10**6)] == [49]


def test_what_is_returned_is_under_way_no_more() -> None:
    feed = adaptive()
    feed.offer(item(1, 0))
    feed.requeue(feed.take(0, 32, 10**6))
    taken = feed.take(S, 32, 10**6)
    feed.on_acknowledged(taken, S + 5 * MS)
    feed.offer(item(2, 3 * S))
    assert feed.waiting == (1, BYTES)


@pytest.mark.parametrize("resource", [EVENT, BOARD])
def test_events_and_boards_are_never_omitted(resource: Resource) -> None:
    feed = adaptive(resource)
    assert feed.link_rate is None
    assert feed.channel.limit_ns == 0


def test_overdriven_board_shows_rate_of_link() -> None:
    board = Feed(BOARD, Rule("**"), 0)
    link = Link(board, lambda _: 100e3)
    written = link.run(10 * MS, 10 * S)  # 0.8 Mbit/s
    rate_hz, reason = board.pace(10 * S)
    assert rate_hz == pytest.approx(len(link.within(5, 10)) / 5, rel=0.1)
    assert "until the one before is acknowledged" in reason
    assert max(one.age_ns for one in link.arrived) < 100 * MS, "each is the newest when it is sent"
    assert board.held_back + len(link.arrived) + board.waiting[0] == pytest.approx(written, abs=2)
    assert board.is_outpaced(10 * S)
    assert not board.is_outpaced(30 * S)
    assert board.pace(30 * S) == (None, "")


def test_board_within_rate_is_not_delayed() -> None:
    board = Feed(BOARD, Rule("**", min_interval_s=0.2), 0)
    link = Link(board, lambda _: 5e6)
    link.run(10 * MS, 5 * S)
    assert board.held_back == 0
    assert UNLIMITED_BIT_S > 1e9
