"""Names, kinds and tree versions of all known nodes, by hardware id."""

from collections.abc import Callable, Collection
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import Hello, MemberRow, PlatformCode
from swarmd.broker.core.beacon.beacon_codec import member_bytes
from swarmware.errors import InvalidInput
from swarmware.model.names import MAIN, Address, hardware_id

REPEAT_NS: Final = 30_000_000_000
"""Period in which an unchanged member row is repeated."""
ANNOUNCEMENTS: Final = 3
"""Consecutive beacons that carry a changed row."""
FORGET_NS: Final = 600_000_000_000
MEMBER_LIMIT: Final = 4096


class KnownNode(msgspec.Struct, gc=False):
    """Name, kind and tree version of a node."""

    hw: int
    name: str
    """As encoded in beacons."""
    platform: str
    unit: str
    kind: PlatformCode = PlatformCode.OTHER
    tree_version: int = 0
    announced_ns: int = 0
    announcements: int = ANNOUNCEMENTS
    received_ns: int = 0


class NodeTable:
    """All known nodes by hardware id."""

    def __init__(self, own_hw: int) -> None:
        self._own_hw = own_hw
        self._all: dict[int, KnownNode] = {}
        self.version = 0
        """Number of the last change."""

    def add(self, platform: str, now_ns: int) -> None:
        """Adds a platform of the roster."""
        hw = hardware_id(platform)
        if hw != self._own_hw:
            self._all.setdefault(hw, KnownNode(hw, platform, platform, MAIN, received_ns=now_ns))

    def on_hello(self, hw: int, hello: Hello, now_ns: int) -> bool:
        """Takes the name in a neighbour's hello. False: the name does not belong to this hardware id."""
        return self._learn(hw, hello.name, hello.kind, hello.tree_version, now_ns)

    def on_row(self, row: MemberRow, now_ns: int) -> bool:
        """Takes the member row of a node that is not in range. False: name and hardware id do not match."""
        return self._learn(row.hw, row.name, row.kind, row.tree_version, now_ns)

    def _learn(self, hw: int, name: str, kind: PlatformCode, tree_version: int, now_ns: int) -> bool:
        node = self._all.get(hw)
        if node is None or node.name != name:
            # the id is a hash of the name; a row cannot give a node the name of another one
            if not is_named(hw, name) or len(self._all) >= MEMBER_LIMIT:
                return False
            address = Address.parse(name)
            node = self._all[hw] = KnownNode(hw, str(address), *address)
            self.version += 1
        if node.tree_version != tree_version or node.kind != kind:
            node.tree_version = tree_version
            node.kind = kind
            node.announcements = ANNOUNCEMENTS
            self.version += 1
        node.received_ns = now_ns
        return True

    def get(self, hw: int) -> KnownNode | None:
        """Entry of a hardware id, or None if its name is unknown."""
        return self._all.get(hw)

    def platform(self, hw: int) -> str:
        """Platform of a hardware id, or the id in hex while the name is unknown."""
        node = self._all.get(hw)
        return node.platform if node is not None else f"{hw:08x}"

    def name(self, hw: int) -> str:
        """Name of a hardware id, platform and unit, or the id in hex while it is unknown."""
        node = self._all.get(hw)
        return node.name if node is not None else f"{hw:08x}"

    def remove(self, hw: int) -> None:
        """Removes a node that is not a member any more."""
        if self._all.pop(hw, None) is not None:
            self.version += 1

    def units_of(self, platforms: Collection[str]) -> list[int]:
        """Hardware ids of all known units of these platforms."""
        return [hw for hw, node in self._all.items() if node.platform in platforms]

    def rows(
        self, now_ns: int, room: int, common: frozenset[int], reachable: Callable[[int], int]
    ) -> list[MemberRow]:
        """Member rows for the next beacon in at most `room` bytes: nodes that not all neighbours receive."""
        out: list[MemberRow] = []
        for node in self._all.values():
            if node.hw in common or (not node.announcements and now_ns - node.announced_ns < REPEAT_NS):
                continue
            # a name without a route is of no use to the receiver
            if not node.received_ns or not reachable(node.hw):
                continue
            row = MemberRow(node.hw, node.tree_version, node.kind, node.name)
            room -= member_bytes(row)
            # the rows left out stay due and are in the next beacon
            if room < 0:
                break
            node.announced_ns = now_ns
            node.announcements = max(0, node.announcements - 1)
            out.append(row)
        return out

    def announce_again(self) -> None:
        """Repeats every row once, for a new neighbour."""
        for node in self._all.values():
            node.announcements = max(node.announcements, 1)

    def forget(self, now_ns: int) -> None:
        """Removes nodes that were not mentioned for ten minutes."""
        for hw in [hw for hw, node in self._all.items() if now_ns - node.received_ns > FORGET_NS]:
            del self._all[hw]
            self.version += 1


def is_named(hw: int, name: str) -> bool:
    """Whether a name as encoded in beacons is valid and belongs to this hardware id."""
    try:
        return Address.parse(name).hardware == hw
    except InvalidInput:
        return False
