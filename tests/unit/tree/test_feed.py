"""What is worth a notification, and when: change, deadband, intervals, order."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.tree.core.notification.condition import differs, rule_for
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.feed_channel import QUEUE_BYTES, QUEUE_LIMIT
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem

S = 1_000_000_000
BOARD = Resource(path="power/battery", type="Float")
EVENT = Resource(path="health/faults", kind=Kind.EVENT, type="Text")


def take(one: Feed, now_ns: int, limit: int) -> list[TreeItem]:
    """Takes an item that is then no longer in flight."""
    taken = one.take(now_ns, limit, 10**9)
    one.on_acknowledged((), 0)
    return taken


def packed(value: object) -> bytes:
    return msgspec.msgpack.encode(value)


def item(value: object, sequence: int = 1, kind: FrameKind = FrameKind.BOARD) -> TreeItem:
    return TreeItem("power/battery", 7, kind, sequence, 0, packed([value]))


@pytest.mark.parametrize(
    ("before", "after", "deadband", "expected"),
    [
        ([1.0], [1.0], 0.0, False),
        ([1.0], [1.001], 0.0, True),
        ([1.0], [1.05], 0.1, False),
        ([1.0], [1.2], 0.1, True),
        ([1.0, "auto"], [1.05, "manual"], 0.1, True),
        ([1.0, [2.0, 3.0]], [1.0, [2.0, 3.05]], 0.1, False),
        ([1.0, [2.0, 3.0]], [1.0, [2.0, 3.5]], 0.1, True),
        ([[1.0]], [[1.0, 2.0]], 9.0, True),
        ({"a": 1.0}, {"a": 1.01}, 0.1, False),
        ({"a": 1.0}, {"b": 1.0}, 0.1, True),
        ([True], [False], 5.0, True),
        ([1.0], [math.nan], 5.0, True),
        ([1], [None], 5.0, True),
    ],
)
def test_a_deadband_holds_for_every_number(
    before: object, after: object, deadband: float, expected: bool
) -> None:
    assert differs(packed(before), packed(after), deadband) is expected


@given(before=st.binary(max_size=20), after=st.binary(max_size=20), deadband=st.sampled_from([0.0, 0.5]))
def test_any_two_payloads_can_be_compared(before: bytes, after: bytes, deadband: float) -> None:
    assert not differs(before, before, deadband)
    assert differs(before, after, 0.0) is (before != after)
    differs(before, after, deadband)


def test_the_first_rule_that_matches_holds() -> None:
    rules = (Rule("power/*", 0.1), Rule("**", 5.0))
    assert rule_for("power/battery", rules).deadband == 0.1
    assert rule_for("nav/pose", rules).deadband == 5.0
    assert rule_for("nav/pose", rules[:1]).deadband == 0.0


def feed(resource: Resource = BOARD, interval_s: float = 0.0, **rule: float) -> Feed:
    return Feed(resource, Rule("**", **rule), round(interval_s * S))


def test_first_value_is_due_and_same_is_not() -> None:
    one = feed()
    one.offer(item(1.0))
    assert (due := one.due_ns()) is not None
    assert due <= 0
    assert take(one, 0, 9) == [item(1.0)]
    assert one.due_ns() is None
    one.offer(item(1.0, 2))
    assert one.due_ns() is None


def test_newest_value_goes_after_least_interval() -> None:
    one = feed(interval_s=0.5)
    one.offer(item(1.0))
    take(one, 0, 9)
    one.offer(item(2.0, 2))
    one.offer(item(3.0, 3))
    assert one.due_ns() == S // 2
    assert take(one, S // 2, 9) == [item(3.0, 3)]


def test_lateness_of_board_does_not_accumulate() -> None:
    one = feed(Resource(path="power/battery", type="Float", rate_hz=1.0, link="notify"))
    one.offer(item(0.0))
    take(one, 9 * S // 10, 9)  # the first one was late: it waited for a subscription
    delays_ns = []
    for second in range(1, 5):
        one.offer(item(float(second), second))
        due_ns = one.due_ns()
        assert due_ns is not None
        sent_ns = max(due_ns, second * S)
        take(one, sent_ns, 9)
        delays_ns.append(sent_ns - second * S)
    assert delays_ns == [S * 4 // 10, 0, 0, 0]


def test_half_period_is_least_interval_unless_ruled() -> None:
    fast = Resource(path="power/battery", type="Float", rate_hz=4.0, link="notify")
    for one, expected in ((feed(fast), S // 8), (feed(fast, min_interval_s=2.0), 2 * S)):
        one.offer(item(1.0))
        take(one, 0, 9)
        one.offer(item(2.0, 2))
        assert one.due_ns() == expected


def test_value_restored_before_sending_is_no_news() -> None:
    one = feed(interval_s=1.0)
    one.offer(item(1.0))
    take(one, 0, 9)
    one.offer(item(2.0, 2))
    one.offer(item(1.0, 3))
    assert one.due_ns() is None


def test_the_deadband_counts_from_the_value_sent_last() -> None:
    one = feed(deadband=1.0)
    one.offer(item(0.0))
    take(one, 0, 9)
    for step in range(1, 4):
        one.offer(item(step * 0.4, step + 1))
    assert take(one, S, 9)[0].sequence == 4, "0.4 and 0.8 were within the band"


def test_after_the_longest_interval_it_is_told_again() -> None:
    one = feed(max_interval_s=10.0)
    one.offer(item(1.0))
    take(one, 0, 9)
    assert one.due_ns() == 10 * S
    assert take(one, 10 * S, 9) == [item(1.0)]
    assert one.due_ns() == 20 * S


def test_failed_board_is_sent_as_it_is() -> None:
    one = feed()
    one.offer(item(1.0))
    lost = take(one, 0, 9)
    one.offer(item(2.0, 2))
    one.requeue(lost)
    assert take(one, S, 9) == [item(2.0, 2)]


def test_failed_board_is_sent_although_unchanged() -> None:
    one = feed()
    one.offer(item(1.0))
    take(one, 0, 9)
    one.offer(item(2.0, 2))
    lost = take(one, 1, 9)
    one.offer(item(1.0, 3))
    one.requeue(lost)
    assert take(one, S, 9) == [item(1.0, 3)], "nobody knows whether 2.0 arrived"


def test_a_subscriber_that_forgot_everything_is_told_again() -> None:
    one = feed(interval_s=5.0)
    one.offer(item(1.0))
    take(one, 0, 9)
    one.reset()
    assert (due := one.due_ns()) is not None
    assert due < S
    assert take(one, S, 9) == [item(1.0)]


def event(sequence: int) -> TreeItem:
    return item("x", sequence, FrameKind.EVENT)


def test_events_go_in_order_failed_ones_first() -> None:
    one = feed(EVENT)
    for sequence in range(1, 6):
        one.offer(event(sequence))
    lost = take(one, 0, 3)
    assert [each.sequence for each in lost] == [1, 2, 3]
    one.requeue(lost)
    assert [each.sequence for each in take(one, 0, 9)] == [1, 2, 3, 4, 5]
    assert one.due_ns() is None


def test_equal_events_are_events() -> None:
    one = feed(EVENT, interval_s=0.0)
    one.offer(event(1))
    one.offer(event(2))
    assert len(take(one, 0, 9)) == 2


def test_queue_without_room_drops_oldest_and_counts_them() -> None:
    one = feed(EVENT)
    for sequence in range(QUEUE_LIMIT + 10):
        one.offer(event(sequence))
    assert one.dropped == 10
    flight = take(one, 0, 50)
    for sequence in range(QUEUE_LIMIT + 10, QUEUE_LIMIT + 40):
        one.offer(event(sequence))
    one.requeue(flight)
    assert one.dropped == 40
    kept = [each.sequence for each in take(one, 0, 10_000)]
    assert kept == list(range(40, QUEUE_LIMIT + 40))


def test_queue_is_byte_limited_except_newest() -> None:
    one = feed(EVENT)
    size = QUEUE_BYTES // 4
    for sequence in range(9):
        one.offer(msgspec.structs.replace(event(sequence), data=bytes(size)))
    assert [each.sequence for each in one.take(0, 99, 2 * size)] == [5, 6]
    one.offer(msgspec.structs.replace(event(9), data=bytes(2 * QUEUE_BYTES)))
    assert [each.sequence for each in one.take(0, 99, 1)] == [9]
    assert one.dropped == 7


def test_next_board_value_waits_for_current() -> None:
    one = feed(BOARD)
    one.offer(item(1.0))
    one.take(0, 9, 999)
    one.offer(item(2.0, 2))
    one.offer(item(3.0, 3))
    assert one.due_ns() is None
    one.on_acknowledged((), 0)
    assert take(one, S, 9) == [item(3.0, 3)]


def test_own_computer_gets_equal_values_without_deadband() -> None:
    board = msgspec.structs.replace(BOARD, rate_hz=10.0)
    counts = []
    for over_wire, deadband in ((True, 0.0), (False, 0.0), (True, 0.5)):
        feed = Feed(board, Rule(pattern="**", deadband=deadband), 0, over_wire=over_wire)
        sent = 0
        for number in range(10):
            feed.offer(item(1.0, number))
            sent += len(take(feed, number * S // 10, 9)) if feed.due_ns() is not None else 0
        counts.append(sent)
    assert counts == [10, 1, 1]
