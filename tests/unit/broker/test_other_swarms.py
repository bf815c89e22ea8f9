"""Marks of sessions distinguish other swarms from forgers, however many marks are invented."""

from swarmd.broker.core.membership.other_swarms import (
    ADDRESSES_MAX,
    FORGET_NS,
    HOSTS_SHOWN,
    SWARMS_MAX,
    OtherSwarms,
)

OWN = 0x123_0000_AB12
THEIRS = 0x456_0000_00C4
HERE, THERE = ("10.0.0.1", 7450), ("10.0.0.9", 7450)


def test_foreign_mark_marks_session_and_its_address() -> None:
    one = OtherSwarms(OWN)
    assert not one.on_unopened(None, THERE, 0), "it has shown no session yet"
    assert one.on_unopened(THEIRS, THERE, 1)
    assert one.on_unopened(None, THERE, 2)
    assert not one.on_unopened(None, HERE, 3)
    assert not one.on_unopened(OWN, HERE, 4), "forged: it names this swarm"
    (found,) = one.table(5)
    assert (found.root, found.datagrams, found.addresses) == ("00c4", 2, ("10.0.0.9",))


def test_address_with_own_mark_leaves_other_swarm() -> None:
    one = OtherSwarms(OWN)
    assert one.on_unopened(THEIRS, THERE, 0)
    assert not one.on_unopened(OWN + (7 << 16), THERE, 1)
    assert not one.on_unopened(None, THERE, 2)


def test_nodes_without_keys_have_no_root() -> None:
    one = OtherSwarms(OWN)
    assert one.on_unopened(0x7_0000, THERE, 0)
    assert one.table(0)[0].root == ""


def test_swarm_silent_for_minute_is_not_reported() -> None:
    one = OtherSwarms(OWN)
    assert one.on_unopened(THEIRS, THERE, 0)
    assert len(one.table(FORGET_NS)) == 1
    assert one.table(FORGET_NS + 1) == ()


def test_invented_marks_and_addresses_take_little_memory() -> None:
    one = OtherSwarms(OWN)
    for number in range(5000):
        assert one.on_unopened(number << 16 | number % 30 + 1, (f"10.0.{number % 250}.1", number), number)
    table = one.table(5000)
    assert len(table) == SWARMS_MAX
    assert max(len(each.addresses) for each in table) <= HOSTS_SHOWN
    assert len(one._marks) <= ADDRESSES_MAX
