"""A stream with snapshots: the state first, the items after it in order, the state again after each gap."""

from itertools import count
from random import Random

import pytest

from swarmware.transport.delivery.resync import StreamResync


def items(resync: StreamResync[str], *sequences: int, stamp_ns: int = 0) -> None:
    for sequence in sequences:
        resync.on_item(sequence, stamp_ns + sequence, f"i{sequence}")


def taken(resync: StreamResync[str]) -> list[str]:
    found: list[str] = []
    while (item := resync.take()) is not None:
        found.append(item)
    return found


def begun(at: int = 10) -> StreamResync[str]:
    resync: StreamResync[str] = StreamResync()
    assert resync.on_snapshot(at, at)
    return resync


def test_items_wait_for_first_snapshot() -> None:
    resync: StreamResync[str] = StreamResync()
    items(resync, 8, 9, 10, 11)
    assert (resync.needs_snapshot, taken(resync)) == (True, [])
    assert resync.on_snapshot(9, 9)
    items(resync, 12)
    assert (resync.needs_snapshot, taken(resync)) == (False, ["i10", "i11", "i12"])
    assert resync.gaps == 0


def test_snapshot_after_gap_precedes_next_item() -> None:
    resync = begun()
    items(resync, 11, 14, 15)
    assert (taken(resync), resync.needs_snapshot, resync.gaps) == (["i11"], True, 2)
    assert resync.on_snapshot(14, 14)
    assert (taken(resync), resync.needs_snapshot) == (["i15"], False)


def test_snapshot_without_following_items_is_ignored() -> None:
    resync = begun()
    items(resync, 14, 15)
    assert not resync.on_snapshot(12, 12), "item 13 is missing"
    assert resync.needs_snapshot
    assert resync.on_snapshot(15, 15)
    assert taken(resync) == []


def test_gap_among_items_that_wait_needs_further_snapshot() -> None:
    resync = begun()
    items(resync, 13, 14, 17, 18)
    assert resync.on_snapshot(13, 13)
    assert (taken(resync), resync.needs_snapshot) == (["i14"], True)
    assert resync.on_snapshot(17, 17)
    assert taken(resync) == ["i18"]


def test_items_that_snapshot_contains_may_come_after_it() -> None:
    resync = begun(20)
    items(resync, 18, 19, 20, 21)
    assert (taken(resync), resync.needs_snapshot) == (["i21"], False)


def test_owner_that_has_restarted_begins_again_with_snapshot() -> None:
    resync = begun(20)
    items(resync, 1, 2, stamp_ns=1000)
    assert resync.needs_snapshot
    assert not resync.on_snapshot(20, 20), "it is of the time before the restart"
    assert resync.on_snapshot(1, 1001)
    assert taken(resync) == ["i2"]


def test_few_items_wait_for_a_snapshot() -> None:
    resync: StreamResync[str] = StreamResync(held_max=3)
    items(resync, *range(10, 20))
    assert not resync.on_snapshot(12, 12)
    assert resync.on_snapshot(16, 16)
    assert taken(resync) == ["i17", "i18", "i19"]


@pytest.mark.parametrize("seed", range(20))
def test_reader_reaches_owners_state_after_any_loss(seed: int) -> None:
    random, resync = Random(seed), StreamResync[int](held_max=8)
    owner, reader, sent = 0, 0, count(1)
    on_way: list[tuple[int, int]] = []
    for _ in range(400):
        sequence, added = next(sent), random.randrange(100)
        owner += added
        if random.random() < 0.8:
            on_way.append((sequence, added))
        while on_way and random.random() < 0.7:
            number, value = on_way.pop(0)
            resync.on_item(number, number, value)
        while (item := resync.take()) is not None:
            reader += item
        if resync.needs_snapshot and random.random() < 0.3 and resync.on_snapshot(sequence, sequence):
            reader = owner
            while (item := resync.take()) is not None:
                reader += item
    last = next(sent)
    for number, value in [*on_way, (last, 0)]:
        resync.on_item(number, number, value)
    while (item := resync.take()) is not None:
        reader += item
    if resync.needs_snapshot:
        assert resync.on_snapshot(last, last)
        reader = owner
    assert reader == owner
