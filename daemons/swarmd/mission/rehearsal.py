"""Reads stored missions in advance, so that an order is accepted without delay."""

import asyncio
from collections.abc import Callable
from typing import Final

from swarmd.mission.checking import Checker
from swarmd.mission.store import MissionStore
from swarmd.mission.values import Values
from swarmware.errors import MissionError
from swarmware.mission.assignment import MemberAssignment, Platform, assign
from swarmware.mission.finding import sound
from swarmware.mission.folder import Folder
from swarmware.mission.model import MissionDefinition, content_hash
from swarmware.types import registry
from swarmware.types.mission import Member, MissionFile, MissionOrder, MissionReceipt, MissionTask

SETTLED_S: Final = 2.0
"""Period of the check: parts are read when no platform has joined or left within it."""
EXPIRES_NS: Final = 1 << 62
"""Expiry of a rehearsed order, which is never sent."""
MISSIONS: Final = 16
"""Maximum number of missions read in advance: a quarter of the checker's cache."""


class Rehearsal:
    """Reads this platform's part in each stored mission, as an order would assign it now.

    An order for another ensemble or mission is read when it arrives.
    """

    def __init__(
        self,
        platform: str,
        store: MissionStore,
        checker: Checker,
        values: Values,
        accept: Callable[[MissionOrder, MissionDefinition], None],
    ) -> None:
        """`accept`: runs the acceptance of an order without effect."""
        self._platform = platform
        self._store = store
        self._checker = checker
        self._values = values
        self._accept = accept
        self._seen: frozenset[Platform] = frozenset()
        self._done: frozenset[Platform] = frozenset()

    def due(self, platforms: frozenset[Platform]) -> bool:
        """Whether these platforms are the same as at the last call, and their parts are not read yet."""
        settled, self._seen = platforms == self._seen, platforms
        return settled and platforms != self._done

    async def play(self, platforms: frozenset[Platform]) -> None:
        """Reads the parts, one in each iteration of the event loop."""
        self._done = platforms
        for folder in self._store.read[:MISSIONS]:
            if not sound(await self._checker.check(folder)):
                continue
            try:
                assignment = assign(folder, list(platforms), {})
            except MissionError:
                continue  # a role stays empty: it cannot be ordered
            for one in assignment.member_assignments:
                if one.member.platform == self._platform:
                    await self._read(folder, one, assignment.members)
            await asyncio.sleep(0)

    async def _read(self, folder: Folder, own: MemberAssignment, members: tuple[Member, ...]) -> None:
        text, file = folder.texts[own.file], folder.place(own.file)
        try:
            mission = await self._checker.load(text, file, own.binding)
        except MissionError:
            return  # an order of it will be refused with the reasons
        # resources of other platforms are subscribed only when the mission is ordered
        self._values.open(path for path in mission.resources if not path.startswith("/"))
        task = MissionTask(files=(MissionFile(file, text),), params=own.binding.params)
        params = own.binding.params
        order = MissionOrder(
            folder.manifest.name,
            folder.hash,
            0,
            own.member.role,
            file,
            text,
            content_hash(text),
            members,
            params,
            self._platform,
            0,
            EXPIRES_NS,
        )
        # builds the decoders, which msgspec does at their first use
        for value in (task, order, MissionReceipt(True, 0)):
            registry.decode(type(value), registry.encode(value))
        self._accept(order, mission)
