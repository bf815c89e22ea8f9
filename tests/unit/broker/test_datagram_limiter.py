"""Datagrams of members are always decrypted, datagrams of others only within a budget."""

from swarmd.broker.core.membership.datagram_limiter import (
    ALL_FAILURES_S,
    FAILURES_S,
    NON_MEMBERS_S,
    DatagramLimiter,
)

MEMBER, STRANGER = 1, 99
SECOND = 1_000_000_000
HOME = ("10.0.0.1", 7447)


def looked_at(
    admission: DatagramLimiter, sender_hw: int, number: int, now_ns: int = SECOND, *, spread: bool
) -> int:
    """Number of bad datagrams that passed the limiter."""
    count = 0
    for index in range(number):
        address = ("10.0.9.9", 1000 + index % 30_000 if spread else 1)
        if admission.may_open(address, sender_hw, now_ns):
            admission.bad(address)
            count += 1
    return count


def test_datagrams_of_non_members_are_dropped_before_cryptography() -> None:
    admission = DatagramLimiter({MEMBER})
    assert looked_at(admission, STRANGER, 10_000, spread=True) == NON_MEMBERS_S
    assert looked_at(admission, STRANGER, 10_000, 2 * SECOND, spread=True) == NON_MEMBERS_S


def test_bad_datagrams_have_budgets_by_address_and_total() -> None:
    admission = DatagramLimiter({MEMBER})
    assert looked_at(admission, MEMBER, 10_000, spread=False) == FAILURES_S
    assert looked_at(admission, MEMBER, 10_000, 2 * SECOND, spread=True) == ALL_FAILURES_S


def test_a_flood_from_elsewhere_costs_a_member_nothing() -> None:
    admission = DatagramLimiter({MEMBER})
    assert admission.may_open(HOME, MEMBER, SECOND)
    admission.good(HOME)
    for second in range(1, 5):
        looked_at(admission, MEMBER, 10_000, second * SECOND, spread=True)
        looked_at(admission, STRANGER, 10_000, second * SECOND, spread=True)
        assert admission.may_open(HOME, MEMBER, second * SECOND)


def test_missing_roster_checks_everyone_within_budget() -> None:
    admission = DatagramLimiter(None)
    assert looked_at(admission, STRANGER, 10_000, spread=True) == ALL_FAILURES_S
