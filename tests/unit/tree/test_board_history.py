"""Boards whose channel has a buffer: what an outage superseded follows the newest value, newest first."""

import itertools
from functools import partial

import pytest
from tests.unit.tree.owner import Owner
from tests.unit.tree.pair import CONFIG, Pair, S, pair

from swarmd.tree.core.action import SendNotify, WriteMirror
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.feed_channel import CATCH_UP
from swarmd.tree.core.notification.lane import LaneNumber
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.testing.virtual import VirtualSwarm
from swarmware.types.channel import ChannelLimit, ChannelSettings
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem, TreeNotify

BATTERY = Resource(path="power/battery", type="Float", owner="hal")
BUFFER = ChannelSettings(buffer_bytes=100_000, buffer_s=60.0)
EVERYTHING = 10**9


def value(sequence: int, stamp_ns: int, data: bytes | None = None) -> TreeItem:
    text = b"%08d" % sequence if data is None else data
    return TreeItem("power/battery", 7, FrameKind.BOARD, sequence, stamp_ns, text)


def board(settings: ChannelSettings = BUFFER, *, deadband: float = 0.0) -> Feed:
    feed = Feed(BATTERY, Rule("**", deadband), 0)
    feed.set_channel(settings)
    return feed


def write(feed: Feed, first: int, last: int, rate_hz: int = 10) -> None:
    for sequence in range(first, last + 1):
        feed.offer(value(sequence, sequence * S // rate_hz))


def drained(feed: Feed, now_ns: int, end_ns: int) -> list[tuple[int, int]]:
    """Time and sequence of former values on a link that takes everything."""
    assert feed.history is not None
    sent = []
    while (due_ns := feed.history.due_ns()) is not None and max(due_ns, now_ns) <= end_ns:
        now_ns = max(due_ns, now_ns)
        sent += [(now_ns, item.sequence) for item in feed.history.take(now_ns, 32, EVERYTHING)]
    return sent


def cut(feed: Feed) -> None:
    """The first value is under way when the link is cut."""
    write(feed, 0, 0)
    assert [item.sequence for item in feed.take(0, 1, 0)] == [0]


def arrive(feed: Feed, now_ns: int) -> list[int]:
    """The newest value is sent, and acknowledged."""
    sent = [item.sequence for item in feed.take(now_ns, 1, EVERYTHING)]
    feed.on_acknowledged((), 0)
    return sent


def test_newest_value_precedes_former_after_outage() -> None:
    feed = board()
    cut(feed)
    write(feed, 1, 50)
    feed.requeue([value(0, 0)])
    assert feed.waiting[0] == 51
    assert arrive(feed, 5 * S) == [50]
    assert [sequence for _, sequence in drained(feed, 5 * S, 5 * S)] == list(range(49, -1, -1))
    assert feed.waiting == (0, 0)
    assert feed.lost == 0


def test_without_a_buffer_a_board_has_no_history() -> None:
    for settings in (ChannelSettings(), ChannelSettings(5.0), ChannelSettings(compression="zlib:1")):
        feed = board(settings)
        cut(feed)
        write(feed, 1, 50)
        assert feed.history is None
        assert feed.waiting[0] == 1


def test_settings_and_other_computers_have_no_history() -> None:
    setting = Resource(path="config/hal/gain", kind=Kind.SETTING, type="Float", default=1.0)
    for feed in (Feed(setting, Rule("**"), 0), Feed(BATTERY, Rule("**"), 0, over_wire=True)):
        feed.set_channel(BUFFER)
        assert feed.history is None


def test_oldest_value_is_dropped_beyond_bytes_or_age() -> None:
    for settings, kept in ((ChannelSettings(buffer_bytes=80), 10), (ChannelSettings(buffer_s=1.0), 11)):
        feed = board(settings)
        cut(feed)
        write(feed, 1, 50)
        assert feed.waiting[0] == kept + 1
        assert feed.lost == 49 - kept
        now_ns = 49 * S // 10
        arrive(feed, now_ns)
        assert [sequence for _, sequence in drained(feed, now_ns, now_ns)] == list(range(49, 49 - kept, -1))


def test_value_aged_before_return_is_dropped() -> None:
    feed = board(ChannelSettings(buffer_s=2.0))
    cut(feed)
    write(feed, 1, 10)
    arrive(feed, 60 * S)
    assert drained(feed, 60 * S, 60 * S) == []
    assert feed.lost == 9


@pytest.mark.parametrize(("written_hz", "max_hz"), [(30, 5.0), (10, 10.0), (100, 20.0)])
def test_rate_limit_holds_for_history_sent_double(written_hz: int, max_hz: float) -> None:
    feed = board(ChannelSettings(max_hz, buffer_s=60.0))
    cut(feed)
    write(feed, 1, 20 * written_hz, written_hz)
    assert feed.waiting[0] == pytest.approx(20 * max_hz, abs=2)
    arrive(feed, 20 * S)
    sent = drained(feed, 20 * S, 25 * S)
    assert len(sent) == pytest.approx(5 * CATCH_UP * max_hz, abs=2)
    written_s = [sequence / written_hz for _, sequence in sent]
    steps = [later - sooner for later, sooner in itertools.pairwise(written_s)]
    assert min(steps) > 0.6 / max_hz
    assert max(steps) < 1.4 / max_hz


def test_unrestricted_link_keeps_nothing() -> None:
    feed = board(ChannelSettings(5.0, buffer_s=60.0))
    for sequence in range(300):
        now_ns = sequence * S // 30
        feed.offer(value(sequence, now_ns))
        while (due_ns := feed.due_ns()) is not None and due_ns < now_ns + S // 30:
            feed.take(max(due_ns, now_ns), 1, EVERYTHING)
            feed.on_acknowledged((), 0)
    assert feed.waiting[0] <= 1
    assert feed.lost == 0


def test_what_does_not_differ_is_not_kept() -> None:
    feed = board(deadband=0.5)
    feed.offer(value(0, 0, b"\x91\x00"))
    feed.take(0, 1, EVERYTHING)
    for sequence, number in enumerate((1, 1, 1, 2, 2, 3), 1):
        feed.offer(value(sequence, sequence * S, bytes((0x91, number))))
    arrive(feed, 9 * S)
    assert [sequence for _, sequence in drained(feed, 9 * S, 9 * S)] == [4, 1]


def test_failed_value_is_kept_unless_newest() -> None:
    feed = board()
    first = value(1, S)
    feed.offer(first)
    feed.requeue(feed.take(S, 1, EVERYTHING))
    assert feed.waiting == (1, 8)
    feed.take(2 * S, 1, EVERYTHING)
    feed.offer(value(2, 2 * S))
    feed.requeue([first])
    assert arrive(feed, 3 * S) == [2]
    assert [sequence for _, sequence in drained(feed, 3 * S, 3 * S)] == [1]


def test_former_values_wait_for_newer_to_arrive() -> None:
    feed = board()
    cut(feed)
    write(feed, 1, 20)
    feed.requeue([value(0, 0)])
    assert drained(feed, 2 * S, 2 * S) == [], "the newest one is not sent yet"
    under_way = feed.take(2 * S, 1, EVERYTHING)
    assert drained(feed, 2 * S, 2 * S) == [], "nor has it arrived"
    feed.on_acknowledged((), 0)
    assert feed.history is not None
    assert [item.sequence for item in feed.history.take(2 * S, 2, EVERYTHING)] == [19, 18]
    feed.offer(value(21, 3 * S))
    under_way = feed.take(3 * S, 1, EVERYTHING)
    assert [item.sequence for item in feed.history.take(3 * S, 2, EVERYTHING)] == [17, 16]
    feed.requeue(under_way)
    assert drained(feed, 3 * S, 3 * S) == [], "the link is cut again"
    assert arrive(feed, 4 * S) == [21]
    assert [sequence for _, sequence in drained(feed, 4 * S, 4 * S)] == list(range(15, -1, -1))


def test_former_values_follow_on_busy_board() -> None:
    feed = board()
    cut(feed)
    followed = []
    for first in range(1, 31, 3):  # a round trip takes as long as three values
        write(feed, first, first + 2)
        feed.on_acknowledged((), 0)
        followed += [sequence for _, sequence in drained(feed, first * S, first * S)]
        feed.take(first * S, 1, EVERYTHING)
    assert followed == [sequence for first in range(1, 28, 3) for sequence in (first + 1, first)]


def test_former_values_follow_unchanged_newest_value() -> None:
    feed = board()
    write(feed, 0, 0)
    arrive(feed, 0)
    write(feed, 1, 3)
    assert drained(feed, S, S) == []
    feed.offer(value(4, S, b"%08d" % 0))
    assert feed.due_ns() is None, "the newest one is not sent again"
    assert [sequence for _, sequence in drained(feed, S, S)] == [3, 2, 1]


def test_board_without_buffer_drops_and_counts() -> None:
    feed = board()
    cut(feed)
    write(feed, 1, 50)
    feed.set_channel(ChannelSettings())
    assert feed.waiting[0] == 1
    assert feed.lost == 49


def test_a_rate_of_zero_sends_and_keeps_nothing() -> None:
    feed = board(ChannelSettings(0.0, buffer_s=60.0))
    write(feed, 0, 50)
    assert feed.history is not None
    assert feed.history.waiting == (0, 0)
    write(feed := board(), 0, 50)
    feed.set_channel(ChannelSettings(0.0, buffer_s=60.0))
    assert feed.history is not None
    assert feed.history.due_ns() is None, "what waits stays until something may be sent"


# -- between two trees


def buffered(**settings: float) -> Pair:
    both = pair("/uav1/power/battery")
    limit = ChannelLimit("power/*", ChannelSettings(**settings))  # type: ignore[arg-type]
    both.trees["uav1"].on_limits((limit,), 0)
    both.wait(1)
    return both


def away(both: Pair, seconds: int) -> None:
    """The subscriber is out of reach while its owner writes ten values a second."""
    uav = both.trees["uav1"]
    uav.on_gone("gcs", both.now_ns)
    begin_ns = both.now_ns
    for sequence in range(1, 10 * seconds + 1):
        both.now_ns = begin_ns + sequence * S // 10
        uav.on_timer(both.now_ns)
        uav.on_values([value(sequence, both.now_ns)], both.now_ns)
    assert not any(isinstance(action, SendNotify) for action in uav.drain())


def test_former_values_have_lowest_priority() -> None:
    both = buffered(buffer_s=30.0)
    away(both, 20)
    both.meet()
    both.wait(1)
    sent = [action for _, action in both.log if isinstance(action, SendNotify) and action.notify.items]
    assert [item.sequence for item in sent[0].notify.items] == [200]
    assert (sent[0].notify.lane, sent[0].kind) == (LaneNumber.BOARDS, FrameKind.BOARD)
    assert {(one.notify.lane, one.kind) for one in sent[1:]} == {(LaneNumber.BACKLOG, FrameKind.FILE)}
    assert [item.sequence for one in sent[1:] for item in one.notify.items] == list(range(199, 0, -1))
    assert both.trees["uav1"].subscribers.dropped == 0


def test_receiver_keeps_former_values_apart_from_board() -> None:
    both = buffered(buffer_s=30.0)
    away(both, 2)
    both.meet()
    both.trees["gcs"].drain()
    uav, gcs = both.trees["uav1"], both.trees["gcs"].core
    written: list[WriteMirror] = []
    while sent := [action.notify for action in uav.drain() if isinstance(action, SendNotify)]:
        for notify in sent:
            found = gcs.on_notify(notify, both.now_ns)
            written += [action for action in found if isinstance(action, WriteMirror)]
            uav.on_notified("gcs", notify, True, both.now_ns)
    assert [(one.item.sequence, one.late) for one in written[:2]] == [(20, False), (19, True)]
    assert [one.late for one in written].count(False) == 1
    assert len(written) == 20


@pytest.mark.parametrize("buffer_s", [30.0, 600.0])
def test_buffered_subscription_outlasts_its_lease(buffer_s: float) -> None:
    assert CONFIG.lease_s == 60.0
    both = buffered(buffer_s=buffer_s)
    away(both, 100)
    uav = both.trees["uav1"]
    assert uav.subscribers.platforms() == (["gcs"] if buffer_s > 100 else [])
    both.meet()
    both.wait(10)
    assert len(both.received["gcs"]) == (1000 if buffer_s > 100 else 0)


def test_busy_link_does_not_end_subscription() -> None:
    both = buffered(buffer_s=600.0)
    away(both, 2)
    both.meet()
    uav = both.trees["uav1"]
    for _ in range(100):
        for action in uav.drain():
            if isinstance(action, SendNotify):
                is_live = action.notify.lane != LaneNumber.BACKLOG
                if is_live:
                    both.hear("gcs", action.notify)
                uav.on_notified("gcs", action.notify, is_live, both.now_ns)
        both.now_ns += 2 * S
        uav.on_timer(both.now_ns)
    assert uav.subscribers.platforms() == ["gcs"]
    both.wait(10)
    assert sorted(item.sequence for item in both.received["gcs"]) == list(range(1, 21))


def test_short_outage_sends_newest_value_only() -> None:
    both = buffered(buffer_s=60.0)
    uav = both.trees["uav1"]
    begin_ns, lost = both.now_ns, []
    for sequence in range(1, 31):
        both.now_ns = begin_ns + sequence * S // 10
        uav.on_values([value(sequence, both.now_ns)], both.now_ns)
        lost += [action.notify for action in uav.drain() if isinstance(action, SendNotify)]
    assert [[item.sequence for item in notify.items] for notify in lost] == [[1]]
    assert {notify.lane for notify in lost} == {LaneNumber.BOARDS}
    uav.on_notified("gcs", lost[0], False, both.now_ns)
    both.wait(5)
    assert [item.sequence for item in both.received["gcs"]] == [30, *range(29, 0, -1)]


class BoardOwner(Owner):
    """An owner whose subscriber distinguishes what becomes the board's value."""

    def __init__(self, net: VirtualSwarm[str]) -> None:
        super().__init__(net)
        self.newest: list[int] = []

    def _arrive(self, notify: TreeNotify, done: list[bool]) -> None:
        before = len(self.got.get(BATTERY.path, ()))
        super()._arrive(notify, done)
        if notify.lane == LaneNumber.BOARDS:
            self.newest += self.got.get(BATTERY.path, [])[before:]


@pytest.mark.parametrize(("seed", "loss"), [(1, 0.0), (2, 0.3)])
def test_lossy_outage_delivers_each_value_in_order(seed: int, loss: float) -> None:
    net: VirtualSwarm[str] = VirtualSwarm(seed, loss=loss, delay_s=(0.002, 0.03))
    owner = BoardOwner(net)
    owner.uav.on_limits((ChannelLimit("power/*", BUFFER),), 0)
    for sequence in range(1, 401):
        net.at(sequence * S // 10, partial(owner.write, value(sequence, sequence * S // 10)))
    net.at(10 * S, lambda: setattr(net, "link", lambda a, b: False))
    net.at(30 * S, lambda: setattr(net, "link", lambda a, b: True))
    net.run_until(60 * S)
    assert set(owner.got[BATTERY.path]) == set(range(1, 401))
    assert owner.newest == sorted(set(owner.newest))
    assert owner.newest[-1] == 400
    assert len(owner.newest) < 250, "those of the outage are former values"
    assert len(owner.got[BATTERY.path]) <= 400 * (1 + 2 * loss)
