"""Rate limit for authentication: datagrams of members first, the rest within a budget."""

from collections.abc import Collection
from typing import Final

from swarmware.model.names import hardware_id
from swarmware.transport.security.roster import Roster

NON_MEMBERS_S: Final = 10
"""Datagrams per second of senders that are not on the roster: a unit of a member may be among them."""
FAILURES_S: Final = 50
"""Failed datagrams per second of one address, after which it is dropped for the rest of the second."""
ALL_FAILURES_S: Final = 500
"""Failed datagrams per second in all, after which only addresses with accepted ones are opened."""
GOOD_MAX: Final = 4096
_SECOND_NS: Final = 1_000_000_000

Address = tuple[str, int]


def member_ids(roster: Roster | None) -> frozenset[int] | None:
    """Hardware ids of the members, or None without a roster."""
    return None if roster is None else frozenset(hardware_id(member.platform) for member in roster.valid())


class DatagramLimiter:
    """Counters of accepted and failed datagrams, reset each second."""

    def __init__(self, members: Collection[int] | None) -> None:
        """`members`: hardware ids on the roster, or None without a roster."""
        self.members = None if members is None else frozenset(members)
        self._second = 0
        self._non_members = 0
        self._failures = 0
        self._by_address: dict[Address, int] = {}
        self._good: dict[Address, int] = {}
        """Addresses with accepted datagrams, and the second of the last one."""

    def may_open(self, address: Address, sender_hw: int, now_ns: int) -> bool:
        """Whether a datagram is to be authenticated and decrypted."""
        second = now_ns // _SECOND_NS
        if second != self._second:
            self._second = second
            self._non_members = self._failures = 0
            self._by_address.clear()
        if self._by_address and self._by_address.get(address, 0) >= FAILURES_S:
            return False
        # a flood of others must not take the budget of neighbours that are known to be genuine
        if address in self._good:
            return True
        if self._failures >= ALL_FAILURES_S:
            return False
        # a unit of a member has an id of its own, which the roster does not name; a few are opened
        if self.members is not None and sender_hw not in self.members:
            self._non_members += 1
            return self._non_members <= NON_MEMBERS_S
        return True

    def good(self, address: Address) -> None:
        """Records an accepted datagram."""
        good = self._good
        if good.get(address) == self._second:
            return
        # the address that was silent for the longest time goes
        if address not in good and len(good) >= GOOD_MAX:
            del good[min(good, key=lambda key: good[key])]
        good[address] = self._second

    def bad(self, address: Address) -> None:
        """Records a datagram that failed authentication or decoding."""
        self._failures += 1
        self._by_address[address] = self._by_address.get(address, 0) + 1
