"""What goes into a beacon: own boards by rate and room, others' boards where they are needed."""

from typing import Final

import pytest

from swarmd.broker.core.beacon.beacon_codec import value_bytes
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.boards.published_boards import PublishedBoards
from swarmd.broker.core.boards.relay_cache import (
    FORGET_NS,
    FURTHER_NS,
    OLDEST_NS,
    PERIOD_NS,
    RelayCache,
    RemoteValue,
)
from swarmware.errors import InvalidInput
from swarmware.types.channel import ChannelLimit, ChannelSettings, SetChannel
from swarmware.types.net import BoardPublication

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
PERIOD: Final = 100 * MS
POSE, BATTERY = 1, 2
OFFERS = (
    BoardPublication("nav/pose", POSE, "Pose"),
    BoardPublication("power/battery", BATTERY, "BatteryState", 1000),
)
UAV2, UAV3, UAV4 = 20, 30, 40
OPERATOR = ChannelLimit("nav/*", ChannelSettings(2.0))
FILE = ChannelLimit("**", ChannelSettings(4.0), from_file=True)
UNLIMITED = ChannelLimit("nav/pose", ChannelSettings(1e6))
NOBODY: Final[frozenset[int]] = frozenset()


@pytest.fixture
def channels() -> ChannelTable:
    return ChannelTable()


@pytest.fixture
def published(channels: ChannelTable) -> PublishedBoards:
    published = PublishedBoards()
    published.offer(OFFERS, channels.board_max_hz)
    return published


def sent(published: PublishedBoards, now_ns: int, room: int = 1000) -> list[int]:
    return [value.data_id for value in published.values(now_ns, room, PERIOD)]


def test_a_board_without_a_value_is_not_sent(published: PublishedBoards) -> None:
    assert sent(published, 0) == []


def test_value_is_sent_with_age_and_repeated(published: PublishedBoards) -> None:
    published.boards[POSE].put(b"here", True, 10 * MS)
    [value] = published.values(30 * MS, 1000, PERIOD)
    assert (value.data_id, value.age_us, value.packed, value.payload) == (POSE, 20_000, True, b"here")
    assert [sent(published, 30 * MS + slot * PERIOD) for slot in range(1, 12)].count([POSE]) == 1


def test_changing_value_is_sent_at_its_interval(
    published: PublishedBoards,
) -> None:
    counts = {POSE: 0, BATTERY: 0}
    for slot in range(100):
        for data_id in (POSE, BATTERY):
            published.boards[data_id].put(b"%d" % slot, False, slot * PERIOD)
        jitter_ns = (slot % 3 - 1) * 4 * MS
        for data_id in sent(published, slot * PERIOD + jitter_ns):
            counts[data_id] += 1
    assert counts == {POSE: 100, BATTERY: 10}


def test_only_values_withheld_by_limit_are_counted(
    published: PublishedBoards,
) -> None:
    pose, battery = published.boards[POSE], published.boards[BATTERY]
    pose.limited = True
    for board in (pose, battery):
        for _ in range(5):
            board.put(b"x", True, 0)
    assert (pose.held_back, battery.held_back) == (4, 0)
    sent(published, 0)
    pose.put(b"y", True, 0)
    assert pose.held_back == 4, "the one before was sent"
    pose.put(b"z", True, 0)
    assert pose.held_back == 5


def test_longest_waiting_value_goes_first_when_short() -> None:
    published = PublishedBoards()
    offers = [BoardPublication(f"a/{index}", index, "Float") for index in range(6)]
    published.offer(offers, lambda _: None)
    order: list[int] = []
    for slot in range(12):
        for board in published.boards.values():
            board.put(b"12345678", False, slot * PERIOD)
        order += sent(published, slot * PERIOD, room=2 * value_bytes(b"12345678"))
    assert [order.count(index) for index in range(6)] == [4] * 6


def test_oversized_value_leaves_its_room_to_others(published: PublishedBoards) -> None:
    published.boards[POSE].put(bytes(900), True, 0)
    published.boards[BATTERY].put(b"low", False, 0)
    assert sent(published, 0, room=500) == [BATTERY]
    assert sent(published, PERIOD, room=1000) == [POSE]


def test_board_no_longer_offered_is_not_sent(published: PublishedBoards, channels: ChannelTable) -> None:
    published.boards[POSE].put(b"x", True, 0)
    published.offer(OFFERS[1:], channels.board_max_hz)
    assert sent(published, 0) == []


def test_channel_limits_rate_and_gives_it_back(published: PublishedBoards, channels: ChannelTable) -> None:
    def rate_hz(start_ns: int) -> int:
        published.offer(OFFERS, channels.board_max_hz)
        count = 0
        for slot in range(20):
            published.boards[POSE].put(b"%d" % slot, True, start_ns + slot * PERIOD)
            count += sent(published, start_ns + slot * PERIOD).count(POSE)
        return count // 2

    channels.set(SetChannel("nav/*", ChannelSettings(2.0), for_s=5.0), 0)
    assert rate_hz(0) == 2
    channels.set(SetChannel("nav/pose", ChannelSettings(0.0)), 0)
    assert rate_hz(10 * SECOND) == 0
    channels.set(SetChannel("nav/pose"), 0)
    assert rate_hz(20 * SECOND) == 2
    channels.advance(5 * SECOND)
    assert rate_hz(30 * SECOND) == 10


@pytest.mark.parametrize(
    ("is_ruled", "rules", "expected_s"),
    [
        (False, (), 1.0),
        (True, (), 1.0),
        (False, (OPERATOR, FILE), 0.5),
        (True, (OPERATOR, FILE), 0.5),
        (False, (FILE,), 0.25),
        (True, (FILE,), 1.0),
        (True, (FILE, UNLIMITED), 1e-6),
    ],
)
def test_rate_of_board_in_beacons_follows_precedence(
    is_ruled: bool, rules: tuple[ChannelLimit, ...], expected_s: float
) -> None:
    channels = ChannelTable(rule for rule in rules if rule.from_file)
    for rule in rules:
        if not rule.from_file:
            channels.set(SetChannel(rule.pattern, rule.settings), 0)
    published = PublishedBoards()
    published.offer((BoardPublication("nav/pose", POSE, "Pose", 1000, is_ruled),), channels.board_max_hz)
    assert published.boards[POSE].period_ns == expected_s * SECOND


def test_the_newest_limit_that_matches_counts(channels: ChannelTable) -> None:
    channels.set(SetChannel("**", ChannelSettings(1.0)), 0)
    channels.set(SetChannel("nav/**", ChannelSettings(5.0)), 0)
    assert channels.max_hz("nav/pose") == 5.0
    assert channels.max_hz("power/battery") == 1.0
    channels.set(SetChannel("**", ChannelSettings(2.0)), 0)
    assert channels.max_hz("nav/pose") == 2.0
    assert [limit.pattern for limit in channels.limits(0).limits] == ["**", "nav/**"]


def test_a_limit_says_how_long_it_holds(channels: ChannelTable) -> None:
    channels.set(SetChannel("nav/pose", ChannelSettings(1.0), for_s=5.0), 0)
    assert channels.limits(2 * SECOND).limits[0].remaining_s == 3.0


def test_a_pattern_that_is_none_is_refused(channels: ChannelTable) -> None:
    with pytest.raises(InvalidInput):
        channels.set(SetChannel("Nav Pose", ChannelSettings(1.0)), 0)


def heard(
    cache: RelayCache,
    stamp_ms: int,
    *,
    sender: int = UAV2,
    hops: int = 1,
    now_ms: int = 0,
    age_ms: int = 0,
    payload: bytes = b"",
) -> RemoteValue | None:
    payload = payload or b"value at %d" % stamp_ms
    now_ns = (now_ms or stamp_ms) * MS
    return cache.on_value(sender, UAV2, POSE, stamp_ms * 1000, age_ms * 1000, hops, True, payload, now_ns)


def told(cache: RelayCache, now_ms: int, room: int = 1000, common: frozenset[int] = NOBODY) -> list[int]:
    return [r.stamp_us // 1000 for r in cache.compose(now_ms * MS, room, common, lambda *_: True)]


def test_newer_value_is_taken_and_older_ignored() -> None:
    cache = RelayCache()
    assert heard(cache, 1000) is not None
    assert heard(cache, 1100) is not None
    assert heard(cache, 1100, sender=UAV3, hops=2) is None
    assert heard(cache, 1000, sender=UAV3, hops=2) is None
    assert (cache.duplicates, cache.late) == (2, 0)
    assert heard(cache, 800, sender=UAV3, hops=2) is None
    assert cache.late == 1


def test_rounded_ages_do_not_make_old_value_new() -> None:
    cache = RelayCache()
    heard(cache, 1000, payload=b"same")
    assert cache.on_value(UAV2, UAV2, POSE, 1_000_150, 0, 1, True, b"same", SECOND) is None
    assert cache.on_value(UAV2, UAV2, POSE, 1_000_150, 0, 1, True, b"other", SECOND) is not None
    old_us = 10_000_000
    assert cache.on_value(UAV2, UAV2, BATTERY, 1_000_000, old_us, 1, True, b"same", SECOND) is not None
    assert cache.on_value(UAV2, UAV2, BATTERY, 1_090_000, old_us, 1, True, b"same", SECOND) is None


def test_origin_with_restarted_clock_is_accepted_later() -> None:
    cache = RelayCache()
    heard(cache, 100_000)
    assert heard(cache, 10, now_ms=101_000) is None
    assert heard(cache, 20, now_ms=103_500) is not None


def test_a_restarted_neighbour_is_believed_at_once() -> None:
    cache = RelayCache()
    heard(cache, 100_000)
    cache.forget_origin(UAV2)
    assert heard(cache, 10, now_ms=100_100) is not None


def test_value_is_relayed_once_with_its_age() -> None:
    cache = RelayCache()
    heard(cache, 1000, now_ms=1005, age_ms=5)
    [relay] = cache.compose(1045 * MS, 1000, NOBODY, lambda *_: True)
    assert (relay.origin_hw, relay.data_id, relay.hops) == (UAV2, POSE, 2)
    assert (relay.stamp_us, relay.age_us) == (1_000_000, 45_000)
    assert told(cache, 1145) == []


@pytest.mark.parametrize(("hops", "beacons"), [(1, 100), (2, 60), (4, 30)])
def test_distant_values_are_relayed_less_often(hops: int, beacons: int) -> None:
    cache = RelayCache()
    told_ns: list[int] = []
    for slot in range(beacons):
        heard(cache, 1000 + slot * 100, sender=UAV3, hops=hops)
        if told(cache, 1000 + slot * 100):
            told_ns.append(slot * PERIOD)
    mean_ns = (told_ns[-1] - told_ns[0]) / (len(told_ns) - 1)
    assert mean_ns == pytest.approx(PERIOD_NS + FURTHER_NS * (hops - 1), rel=0.05)


def test_value_received_by_all_neighbours_is_not_relayed() -> None:
    cache = RelayCache()
    heard(cache, 1000)
    assert told(cache, 1000, common=frozenset((UAV2,))) == []


def test_what_no_neighbour_lacks_is_not_passed_on() -> None:
    cache = RelayCache()
    heard(cache, 1000)
    heard(cache, 1000, sender=UAV3, hops=2)
    asked: list[tuple[int, set[int]]] = []

    def needed(origin_hw: int, have: set[int]) -> bool:
        asked.append((origin_hw, set(have)))
        return False

    assert cache.compose(1000 * MS, 1000, NOBODY, needed) == []
    assert asked == [(UAV2, {UAV2, UAV3})]


def test_value_relayed_by_another_waits_like_own() -> None:
    cache = RelayCache()
    told_ms: list[int] = []
    for now_ms in range(1000, 1400, 20):
        if now_ms % 100 == 0:
            heard(cache, now_ms)
        if now_ms == 1020:
            heard(cache, 1000, sender=UAV3, hops=2, now_ms=1020)
        if cache.compose(now_ms * MS, 1000, NOBODY, lambda *_, some=now_ms >= 1060: some):
            told_ms.append(now_ms)
    assert told_ms[0] == 1160, "130 ms after the other one"


def test_relay_nearer_to_origin_does_not_count() -> None:
    cache = RelayCache()
    heard(cache, 1000, sender=UAV3, hops=3)
    heard(cache, 1000, sender=UAV4, hops=2, now_ms=1010)
    assert cache.compose(1020 * MS, 1000, NOBODY, lambda *_: False) == []
    assert told(cache, 1030) == [1000]


def test_valid_value_is_relayed_again_each_second() -> None:
    cache = RelayCache()
    counts = 0
    for slot in range(50):
        if slot % 10 == 0:
            heard(cache, 1000, now_ms=1000 + slot * 100, age_ms=slot * 100)
        counts += len(told(cache, 1000 + slot * 100))
    assert counts == 5


def test_unconfirmed_value_is_no_longer_relayed() -> None:
    cache = RelayCache()
    heard(cache, 1000)
    assert told(cache, 1000 + OLDEST_NS // MS + 1) == []


def test_relays_stay_within_their_budget_longest_waiting_first() -> None:
    cache = RelayCache()
    said: list[int] = []
    for slot in range(21):
        for data_id in range(6):
            cache.on_value(UAV2, UAV2, data_id, slot * 100_000, 0, 1, True, bytes(82), slot * PERIOD)
        out = cache.compose(slot * PERIOD, 200, NOBODY, lambda *_: True)
        assert len(out) == 2
        said += [relay.data_id for relay in out]
    assert [said.count(data_id) for data_id in range(6)] == [7] * 6


def test_near_values_go_first_without_forgetting_far() -> None:
    cache = RelayCache()
    said: list[int] = []
    for slot in range(60):
        for hops in (1, 2, 6):
            cache.on_value(UAV3, hops, POSE, slot * 100_000, 0, hops, True, bytes(82), slot * PERIOD)
        said += [r.origin_hw for r in cache.compose(slot * PERIOD, 100, NOBODY, lambda *_: True)]
    counts = [said.count(hops) for hops in (1, 2, 6)]
    assert counts == sorted(counts, reverse=True)
    assert counts[2] >= 2


def test_entry_silent_for_minute_is_forgotten() -> None:
    cache = RelayCache()
    heard(cache, 1000)
    assert cache.newest(UAV2, POSE) is not None
    cache.forget(SECOND + FORGET_NS + 1)
    assert cache.newest(UAV2, POSE) is None
