"""Who is who: names, trees and kinds of all nodes, near and far."""

from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.core.tick import Hello, MemberRow, PlatformKind, member_bytes
from swarmware.errors import InvalidInput
from swarmware.names import check_platform, hardware_id

AGAIN_NS: Final = 30_000_000_000
"""An unchanged member row is repeated this often."""
TIMES: Final = 3
"""A changed one is said so often, in one datagram after the other."""
FORGET_NS: Final = 600_000_000_000
MEMBER_LIMIT: Final = 4096


class Member(msgspec.Struct, gc=False):
    """One node as we know it."""

    hw: int
    platform: str
    unit: str
    kind: PlatformKind = PlatformKind.OTHER
    tree_version: int = 0
    said_ns: int = 0
    times: int = TIMES
    heard_ns: int = 0

    @property
    def name(self) -> str:
        """Name on the wire."""
        return wire_name(self.platform, self.unit)


class Members:
    """Names and trees by hardware id."""

    def __init__(self, own_hw: int) -> None:
        self._own_hw = own_hw
        self._all: dict[int, Member] = {}
        self.version = 0
        """Another number after each change."""

    def know(self, platform: str, now_ns: int) -> None:
        """A name from the roster."""
        hw = hardware_id(platform)
        if hw != self._own_hw:
            self._all.setdefault(hw, Member(hw, platform, "main", heard_ns=now_ns))

    def on_hello(self, hw: int, hello: Hello, now_ns: int) -> bool:
        """A neighbour's own words. False: the name does not belong to this hardware id."""
        return self._learn(hw, hello.name, hello.kind, hello.tree_version, now_ns)

    def on_row(self, row: MemberRow, now_ns: int) -> bool:
        """What the next hop to that node says about it."""
        return self._learn(row.hw, row.name, row.kind, row.tree_version, now_ns)

    def _learn(self, hw: int, name: str, kind: PlatformKind, tree_version: int, now_ns: int) -> bool:
        member = self._all.get(hw)
        if member is None or member.name != name:
            platform, _, unit = name.partition(".")
            try:
                check_platform(platform)
                if unit:
                    check_platform(unit)
            except InvalidInput:
                return False
            if hardware_id(platform, unit or "main") != hw or len(self._all) >= MEMBER_LIMIT:
                return False
            member = self._all[hw] = Member(hw, platform, unit or "main")
            self.version += 1
        if member.tree_version != tree_version or member.kind != kind:
            member.tree_version = tree_version
            member.kind = kind
            member.times = TIMES
            self.version += 1
        member.heard_ns = now_ns
        return True

    def get(self, hw: int) -> Member | None:
        """A node, if its name is known."""
        return self._all.get(hw)

    def platform(self, hw: int) -> str:
        """Its platform, or the hardware id in hex."""
        member = self._all.get(hw)
        return member.platform if member is not None else f"{hw:08x}"

    def rows(
        self, now_ns: int, room: int, common: frozenset[int], reachable: Callable[[int], int]
    ) -> list[MemberRow]:
        """Member rows for the next datagram in at most `room` bytes: nodes that not all neighbours hear."""
        out: list[MemberRow] = []
        for member in self._all.values():
            if member.hw in common or (not member.times and now_ns - member.said_ns < AGAIN_NS):
                continue
            if not member.heard_ns or not reachable(member.hw):
                continue
            row = MemberRow(member.hw, member.tree_version, member.kind, member.name)
            room -= member_bytes(row)
            if room < 0:
                break
            member.said_ns = now_ns
            member.times = max(0, member.times - 1)
            out.append(row)
        return out

    def repeat(self) -> None:
        """Somebody new is in range: every row is said once more."""
        for member in self._all.values():
            member.times = max(member.times, 1)

    def forget(self, now_ns: int) -> None:
        """Drops whom nobody has mentioned for ten minutes."""
        for hw in [hw for hw, member in self._all.items() if now_ns - member.heard_ns > FORGET_NS]:
            del self._all[hw]
            self.version += 1


def wire_name(platform: str, unit: str) -> str:
    """`uav3`, or `uav3.fc1` where the unit is not `main`."""
    return platform if unit == "main" else f"{platform}.{unit}"
