"""Digests of the last beacons: a group that one side took otherwise than the other sent it is found."""

import pytest

from swarmd.broker.core.beacon.beacon_history import (
    GROUP,
    GROUPS_MAX,
    HISTORY,
    BeaconHistory,
    datagram_digest,
)

FIRST = 1000
"""A multiple of GROUP."""


def filled(count: int, *, without: tuple[int, ...] = (), changed: tuple[int, ...] = ()) -> BeaconHistory:
    history = BeaconHistory()
    for sequence in range(FIRST, FIRST + count):
        if sequence not in without:
            history.record(sequence, sequence + (10_000 if sequence in changed else 0))
    return history


def test_the_same_beacons_have_the_same_groups_and_another_salt_has_others() -> None:
    groups = filled(56).groups(7, FIRST + 56)
    assert groups == filled(56).groups(7, FIRST + 56)
    assert len(groups) == GROUPS_MAX
    assert None not in groups
    assert groups != filled(56).groups(8, FIRST + 56)


@pytest.mark.parametrize("forged", [0, 7, 8, 40, 47])
def test_one_other_beacon_of_the_last_48_is_found(forged: int) -> None:
    stated = [group or 0 for group in filled(48).groups(7, FIRST + 48)]
    taken = filled(48, changed=(FIRST + forged,))
    assert taken.contradicts(7, FIRST + 48, stated)


def test_a_group_of_which_a_beacon_is_missing_is_not_compared() -> None:
    stated = [group or 0 for group in filled(48).groups(7, FIRST + 48)]
    assert not filled(48, without=(FIRST + 3, FIRST + 20)).contradicts(7, FIRST + 48, stated)
    assert not filled(48, without=(FIRST + 3,), changed=(FIRST + 4,)).contradicts(7, FIRST + 48, stated)


def test_beacons_with_numbers_that_the_sender_never_used_are_found() -> None:
    jumped = filled(8)
    jumped.record(FIRST + 40, 1)
    stated = [group or 0 for group in jumped.groups(7, FIRST + 40)]
    assert stated[0] == 0
    assert filled(40).contradicts(7, FIRST + 40, stated)


def test_only_the_last_64_beacons_are_remembered() -> None:
    history = filled(HISTORY + 10)
    assert history.digest(FIRST + 9) is None
    assert history.digest(FIRST + 10) == FIRST + 10
    assert history.digest(FIRST + HISTORY + 10) is None, "not sent yet"
    history.record(FIRST + 5, 1)
    assert history.digest(FIRST + 5) is None, "too old to be remembered"
    history.record(FIRST + 10 * HISTORY, 2)
    assert history.digest(FIRST + HISTORY) is None, "a jump leaves nothing of what was before"
    assert history.digest(FIRST + 10 * HISTORY) == 2


def test_a_late_beacon_fills_its_place() -> None:
    history = filled(GROUP, without=(FIRST + 2,))
    assert history.groups(7, FIRST + GROUP)[0] is None
    history.record(FIRST + 2, FIRST + 2)
    assert history.groups(7, FIRST + GROUP) == filled(GROUP).groups(7, FIRST + GROUP)


def test_digests_of_datagrams_differ_in_any_byte() -> None:
    assert datagram_digest(b"one") == datagram_digest(b"one") != datagram_digest(b"onf")
