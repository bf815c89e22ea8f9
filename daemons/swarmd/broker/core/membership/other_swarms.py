"""Other swarms on the same network, by the mark that a session has of its swarm."""

from typing import Final

import msgspec

from swarmware.transport.security.seal import SESSION_MARK
from swarmware.types.traffic import OtherSwarm

SWARMS_MAX: Final = 8
"""Swarms that are remembered; a further one replaces that which was silent for longest."""
ADDRESSES_MAX: Final = 256
HOSTS_SHOWN: Final = 8
"""Addresses of one swarm that are reported."""
FORGET_NS: Final = 60_000_000_000
"""Silence after which another swarm is not reported any more."""

Address = tuple[str, int]


class _Swarm(msgspec.Struct, gc=False):
    """Datagrams that arrived from one swarm."""

    datagrams: int = 0
    newest_ns: int = 0
    hosts: dict[str, None] = {}


class OtherSwarms:
    """Distinguishes datagrams of other swarms from forged ones, among those that no key of this swarm opens.

    Not every datagram has a session: the last one of its address that had one decides.
    """

    def __init__(self, own_session: int) -> None:
        self._own = own_session & SESSION_MARK
        self._marks: dict[Address, int] = {}
        """Mark of the last session that an address showed."""
        self._swarms: dict[int, _Swarm] = {}

    def on_unopened(self, session: int | None, address: Address, now_ns: int) -> bool:
        """Takes a datagram that was not opened; returns True if it is of another swarm."""
        if session is not None:
            self._marks.pop(address, None)
            # addresses can be invented, so the oldest one goes
            if len(self._marks) >= ADDRESSES_MAX:
                del self._marks[next(iter(self._marks))]
            self._marks[address] = session & SESSION_MARK
        # unknown addresses count as own ones; a forged datagram must not hide as another swarm
        mark = self._marks.get(address, self._own)
        if mark == self._own:
            return False
        swarm = self._swarms.get(mark)
        if swarm is None:
            if len(self._swarms) >= SWARMS_MAX:
                del self._swarms[min(self._swarms, key=lambda each: self._swarms[each].newest_ns)]
            swarm = self._swarms[mark] = _Swarm()
        swarm.datagrams += 1
        swarm.newest_ns = now_ns
        if len(swarm.hosts) < HOSTS_SHOWN:
            swarm.hosts[address[0]] = None
        return True

    def table(self, now_ns: int) -> tuple[OtherSwarm, ...]:
        """The swarms that were received in the last minute."""
        for mark in [mark for mark, each in self._swarms.items() if now_ns - each.newest_ns > FORGET_NS]:
            del self._swarms[mark]
        return tuple(
            OtherSwarm(f"{mark:04x}" if mark else "", each.datagrams, tuple(each.hosts))
            for mark, each in sorted(self._swarms.items())
        )
