"""A window of notifications: in order at the subscriber, whatever is lost, late or doubled on the way."""

import random
from functools import partial
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.tree.owner import FAULTS, LIDAR, Owner
from tests.unit.tree.pair import S

from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.lane import LANE, LaneNumber, NotificationLane
from swarmd.tree.core.notification.reorder_buffer import REORDER_WINDOW, ReorderBuffer
from swarmware.errors import WireError
from swarmware.model.frame import FrameKind
from swarmware.testing.virtual import VirtualSwarm
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem, TreeNotify

ITEM = b"x" * 1000


def item(path: str, sequence: int, data: bytes = ITEM, kind: FrameKind = FrameKind.STREAM) -> TreeItem:
    return TreeItem(path, 7, kind, sequence, sequence, data)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("rate_hz", "loss", "share"), [(30, 0.0, 0.99), (30, 0.3, 0.9), (100, 0.3, 0.9), (100, 0.45, 0.7)]
)
def test_stream_arrives_whole_over_lossy_link(seed: int, rate_hz: int, loss: float, share: float) -> None:
    net: VirtualSwarm[str] = VirtualSwarm(seed, loss=loss, delay_s=(0.002, 0.03))
    owner = Owner(net)
    count = 20 * rate_hz
    for number in range(1, count + 1):
        net.at(round(number / rate_hz * S), partial(owner.write, item("sensor/lidar", number)))
    net.run_until(20 * S)
    in_time = len(owner.got["sensor/lidar"])
    net.run_for(20)
    assert owner.got["sensor/lidar"] == list(range(1, count + 1))
    assert owner.uav.subscribers.dropped == 0
    assert in_time >= count * share
    assert owner.most_under_way <= 2 * LANE.count_max


@pytest.mark.parametrize("seed", range(3))
def test_twenty_second_outage_loses_nothing(seed: int) -> None:
    net: VirtualSwarm[str] = VirtualSwarm(seed, loss=0.1, delay_s=(0.002, 0.03))
    owner = Owner(net)
    for number in range(1, 1201):
        net.at(round(number / 30 * S), partial(owner.write, item("sensor/lidar", number)))
    net.at(5 * S, lambda: setattr(net, "link", lambda a, b: False))
    net.at(25 * S, lambda: setattr(net, "link", lambda a, b: True))
    net.run_until(60 * S)
    assert owner.got["sensor/lidar"] == list(range(1, 1201))


def test_busy_stream_starves_no_other_traffic() -> None:
    net: VirtualSwarm[str] = VirtualSwarm(1, loss=0.2, delay_s=(0.02, 0.05))
    owner = Owner(net)
    for number in range(1, 20_000):
        net.at(number * S // 2000, partial(owner.write, item("sensor/lidar", number)))
    for number in range(1, 300):
        at_ns = number * S // 30
        net.at(at_ns, partial(owner.write, item("sensor/sonar", number)))
        net.at(at_ns, partial(owner.write, item("health/faults", number, b"x", FrameKind.EVENT)))
        battery = item("power/battery", number, bytes([number % 99]), FrameKind.BOARD)
        net.at(at_ns, partial(owner.write, battery))
    net.run_until(10 * S)
    assert len(owner.got["sensor/sonar"]) > 200
    assert len(owner.got["health/faults"]) > 240
    # at any time, not only at the end: one message that is given up costs two seconds and a pause: 90 values
    battery_values = [0, *owner.got["power/battery"], 300]
    assert max(after - before for before, after in pairwise(battery_values)) < 96
    for sequences in owner.got.values():
        assert sequences == sorted(set(sequences))
    lost = owner.uav.subscribers.losses()
    assert set(lost) == {("sensor/lidar", "gcs")}, "the stream beyond its way's capacity, and only that"
    net.run_for(60)
    assert lost["sensor/lidar", "gcs"] + len(owner.got["sensor/lidar"]) <= 19_999
    assert owner.uav.subscribers.losses()["sensor/lidar", "gcs"] + len(owner.got["sensor/lidar"]) == 19_999


def test_traffic_in_flight_is_bounded_in_bytes() -> None:
    net: VirtualSwarm[str] = VirtualSwarm(1, loss=1.0)
    owner = Owner(net)
    for number in range(1, 4000):
        net.at(number * S // 4000, partial(owner.write, item("sensor/lidar", number)))
    net.run_until(S + S // 2)
    assert owner.most_under_way * 32_000 <= LANE.window_max + 2 * 33_000


def fill(lane: NotificationLane, now_ns: int) -> list[int]:
    """Serials of notifications of 8 kB until the window is full."""
    serials: list[int] = []
    feed = Feed(LIDAR, Rule("**"), now_ns)
    while lane.has_room():
        packets = [item("sensor/lidar", 1, bytes(8_192))]
        notify = TreeNotify("uav1", 1, 0, tuple(packets))
        serials.append(lane.send(notify, [(feed, packets)], now_ns).serial)
    return serials


def test_window_follows_what_link_delivers() -> None:
    lane = NotificationLane(LaneNumber.STREAMS)
    first = fill(lane, 0)
    assert len(first) == LANE.window_first // 8_192
    for serial in first:
        lane.failed(serial, 2 * S, (S,))
    for serial in first:
        lane.delivered(serial, 3 * S)
    few = fill(lane, 3 * S)
    assert 1 <= len(few) < len(first)
    most = 0
    for second in range(4, 40):
        for serial in few:
            lane.delivered(serial, second * S)
        few = fill(lane, second * S)
        most = max(most, len(few))
    assert most == LANE.window_max // 8_192


def test_failed_items_repeat_at_delivery_rate() -> None:
    lane = NotificationLane(LaneNumber.STREAMS)
    first = fill(lane, 0)
    for serial in first:
        lane.failed(serial, 2 * S, (S,))
    assert lane.due_ns() == 3 * S
    under_way = [notify.serial for notify in lane.repeat(3 * S)]
    assert under_way == first[: len(first) // 2], "half of what failed"
    assert lane.due_ns() is None, "the rest waits for these"
    assert not lane.has_room()
    while under_way:
        lane.delivered(under_way.pop(0), 4 * S)
        under_way += [notify.serial for notify in lane.repeat(4 * S)]
    assert not lane, "all have arrived"


def test_a_single_loss_among_deliveries_changes_nothing() -> None:
    lane = NotificationLane(LaneNumber.STREAMS)
    lost, *others = fill(lane, 0)
    for serial in others:
        lane.delivered(serial, S)
    lane.failed(lost, 2 * S, (S,))
    assert len(fill(lane, 2 * S)) >= len(others)


@given(st.randoms(use_true_random=False), st.integers(1, 40), st.integers(1, 5))
def test_any_order_is_taken_once_and_sorted(rnd: random.Random, count: int, copies: int) -> None:
    arrivals = ReorderBuffer()
    pool = [TreeNotify("uav1", 1, serial, first=1) for serial in range(1, count + 1)] * copies
    rnd.shuffle(pool)
    taken = [note.serial for came in pool for note in arrivals.take(came)]
    assert taken == list(range(1, count + 1))


def test_abandoned_item_is_not_awaited() -> None:
    arrivals = ReorderBuffer()
    note = TreeNotify("uav1", 1, 5, first=3)
    assert arrivals.take(note) == []
    assert arrivals.take(TreeNotify("uav1", 1, 7, first=3)) == []
    assert [one.serial for one in arrivals.take(TreeNotify("uav1", 1, 8, first=6))] == [5]
    assert [one.serial for one in arrivals.take(TreeNotify("uav1", 1, 6, first=6))] == [6, 7, 8]
    assert arrivals.take(note) == []


def test_serial_beyond_window_is_refused_without_memory() -> None:
    with pytest.raises(WireError, match="window"):
        ReorderBuffer().take(TreeNotify("uav1", 1, 3 + REORDER_WINDOW, first=3))
    with pytest.raises(WireError, match="window"):
        ReorderBuffer().take(TreeNotify("uav1", 1, 2, first=3))


def test_repetition_states_serials_not_to_await() -> None:
    lane, feed = NotificationLane(LaneNumber.UPDATES), Feed(FAULTS, Rule("**"), 0)
    for serial in (1, 2):
        event = item("health/faults", serial, kind=FrameKind.EVENT)
        lane.send(TreeNotify("uav1", 1, 0, (event,)), [(feed, [event])], 0)
    lane.delivered(1, 1)
    assert lane.failed(2, 2, (S,))
    (again,) = lane.repeat(3)
    assert (again.serial, again.first) == (2, 2)
    arrivals = ReorderBuffer()
    assert arrivals.take(again) == [again]
