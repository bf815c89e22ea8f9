"""Directory of the computers that serve a path, from the register's table of partners on this node."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from swarmware.errors import WireError
from swarmware.model import names
from swarmware.model.names import MAIN, Address
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry

if TYPE_CHECKING:
    from swarmware.node.follower import RingFollower
    from swarmware.types.register import PartnerUnit

PATH: Final = "register/partners"
"""Board of the register daemon; it stays readable while no register daemon runs."""


class UnitDirectory:
    """The computers of platforms that have several; it knows none before the register has published."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._ring = ring_file(node.shm_dir, PATH)
        self._ring_name = str(self._ring)
        self._follower: RingFollower | None = None  # opened by the first message: many modules send none
        self._units: dict[str, list[PartnerUnit]] = {}
        """Units of the platforms that have several, except this computer; reachable ones and `main` first."""

    def has_several(self, platform: str) -> bool:
        """Whether a platform has another computer than its unit `main`, or than this one."""
        self._refresh()
        return platform in self._units

    def serving(self, platform: str, path: str) -> Address | None:
        """The computer that serves a local path, else `main` or the first one, or None for this computer.

        Only units that are not `main` publish what they serve.
        """
        self._refresh()
        units = self._units.get(platform, [])
        serving = (unit for unit in units if any(path in app.serves for app in unit.table.applications))
        found = next(serving, None)
        if found is None and (platform != self._node.platform or self._node.address.unit != MAIN):
            found = next(iter(units), None)
        return None if found is None else Address(platform, found.table.unit)

    def _refresh(self) -> None:
        follower = self._follower
        if follower is None:
            if not os.access(self._ring_name, os.F_OK):  # for each message: no Path object
                return  # no register has run here
            from swarmware.node.follower import RingFollower

            follower = self._follower = RingFollower(
                self._ring,
                name=f"board {PATH}",
                data_id=names.data_id(PATH, "PartnerTable"),
            )
        # Each message asks: two reads of shared memory in place of a copy and a decoding.
        if follower.ring is not None and follower.ring.unchanged:
            return
        frame = follower.newest()
        if frame is None:
            return
        from swarmware.types.register import PartnerTable  # a process that sends no message needs no table

        try:
            table = registry.decode(PartnerTable, frame.payload, frame.codec)
        except WireError as error:
            follower.refuse(error)
        else:
            self._units = _by_platform(table.units, self._node.platform)

    def close(self) -> None:
        """Stop reading the table."""
        if self._follower is not None:
            self._follower.close()
            self._follower = None


def _by_platform(units: Iterable[PartnerUnit], own: str) -> dict[str, list[PartnerUnit]]:
    found: dict[str, list[PartnerUnit]] = {}
    for unit in units:
        found.setdefault(unit.table.platform, []).append(unit)
    for platform in list(found):
        if platform != own and all(unit.table.unit == MAIN for unit in found[platform]):
            del found[platform]  # its only computer
    for one in found.values():
        one.sort(key=lambda unit: (unit.unreachable_since_ns is not None, unit.table.unit != MAIN))
    return found
