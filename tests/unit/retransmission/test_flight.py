"""What is in flight, how much of it the window permits, and what a failure changes."""

from random import Random

import pytest
from msgspec.structs import replace

from swarmware.transport.retransmission.flight import Flight, Sent
from swarmware.transport.retransmission.policy import RetransmissionPolicy

S = 1_000_000_000
WINDOW = RetransmissionPolicy(window_first=4, window_min=1, window_max=8, window_growth=0.5)
PAUSES_NS = (S, 3 * S)
SPARING = replace(WINDOW, ignores_single_losses=True)

Event = tuple[str, int, int]
"""What happens, to the item with this number, at this time in s."""


def flight(policy: RetransmissionPolicy, *events: Event) -> Flight[int, Sent]:
    found: Flight[int, Sent] = Flight(policy)
    for event, number, at_s in events:
        if event == "send":
            found.add(number, Sent(sent_ns=at_s * S))
        elif event == "arrive":
            found.acknowledge(number, at_s * S)
        else:
            found.fail(number, at_s * S, PAUSES_NS)
    return found


def room(found: Flight[int, Sent]) -> int:
    """Further items that the window permits."""
    count = 0
    while found.has_room():
        found.add(1000 + count, Sent(sent_ns=0))
        count += 1
    return count


SENT: list[Event] = [("send", number, 0) for number in range(4)]
ALL_FAIL: list[Event] = [("fail", number, 2) for number in range(4)]
NEVER_TWO: list[Event] = [("arrive", 0, 1), ("arrive", 1, 1)]


@pytest.mark.parametrize(
    ("policy", "events", "failures", "backoff_until_s", "room_after"),
    [
        (WINDOW, [], 0, 0, 4),
        (WINDOW, SENT, 0, 0, 0),
        (WINDOW, [*SENT, *NEVER_TWO], 0, 0, 3),
        (WINDOW, [*SENT, ("fail", 0, 1)], 1, 2, 0),
        (WINDOW, [*SENT, ("fail", 0, 1), ("fail", 0, 1)], 1, 2, 0),
        (WINDOW, [*SENT, ("fail", 9, 1)], 0, 0, 0),
        (WINDOW, [*SENT, *ALL_FAIL], 4, 5, 0),
        (WINDOW, [*SENT, *ALL_FAIL, ("arrive", 0, 6)], 0, 0, 0),
        (replace(WINDOW, keeps_backoff=True), [*SENT, *ALL_FAIL, ("arrive", 0, 6)], 4, 5, 0),
        (SPARING, [*SENT, *ALL_FAIL], 1, 3, 0),
        (SPARING, [*SENT, *NEVER_TWO, ("fail", 2, 2)], 0, 0, 3),
        (replace(WINDOW, count_max=2), SENT[:1], 0, 0, 1),
        (RetransmissionPolicy(), SENT, 0, 0, None),
    ],
)
def test_window_follows_successes_and_failures(
    policy: RetransmissionPolicy,
    events: list[Event],
    failures: int,
    backoff_until_s: int,
    room_after: int | None,
) -> None:
    found = flight(policy, *events)
    assert (found.failures, found.backoff_until_ns) == (failures, backoff_until_s * S)
    if room_after is None:
        assert found.has_room(1 << 40)
    else:
        assert room(found) == room_after


def test_lost_items_return_oldest_first_within_window() -> None:
    found = flight(WINDOW, *SENT, ("fail", 2, 2), ("fail", 0, 2), ("fail", 1, 2))
    assert found.repeatable() == [], "the fourth is in flight and fills the window of one"
    found.fail(3, 2 * S)
    assert found.repeatable() == [0]
    found.resend(0, 6 * S)
    assert found.repeatable() == []
    found.acknowledge(0, 7 * S)
    assert found.repeatable() == [1]


def test_item_larger_than_window_is_sent_alone() -> None:
    found: Flight[int, Sent] = Flight(WINDOW)
    assert found.has_room(100)
    found.add(1, Sent(sent_ns=0, size=100))
    assert not found.has_room()
    found.fail(1, S)
    assert found.repeatable() == [1]


def test_round_trip_is_measured_from_single_transmissions() -> None:
    found, item = Flight[int, Sent](WINDOW), Sent(sent_ns=S)
    found.add(1, item)
    assert item.round_trip_ns(3 * S) == 2 * S
    found.resend(1, 2 * S)
    assert item.round_trip_ns(3 * S) is None


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("policy", [WINDOW, SPARING, replace(WINDOW, keeps_backoff=True)])
def test_every_item_arrives_within_the_window(seed: int, policy: RetransmissionPolicy) -> None:
    """An owner that repeats by report, over a way that loses four of ten and answers in any order."""
    draw, found, waiting, now_ns = Random(seed), Flight[int, Sent](policy), list(range(100)), 0
    under_way: list[int] = []
    while waiting or found:
        now_ns = max(now_ns + S // 10, found.backoff_until_ns if not under_way else 0)
        while waiting and found.has_room():
            number = waiting.pop(0)
            found.add(number, Sent(sent_ns=now_ns))
            under_way.append(number)
        if now_ns >= found.backoff_until_ns:
            for number in found.repeatable():
                found.resend(number, now_ns)
                under_way.append(number)
        assert 1 <= len(under_way) <= policy.window_max
        number = under_way.pop(draw.randrange(len(under_way)))
        if draw.random() < 0.4:
            assert found.fail(number, now_ns, PAUSES_NS)
        else:
            assert found.acknowledge(number, now_ns)
            assert found.acknowledge(number, now_ns) is None, "a duplicate"
    assert now_ns < 3600 * S
