"""Watches a swarm from its ground station: who is known, how the mission goes; woken by events."""

import asyncio
from collections.abc import Callable, Collection, Mapping
from typing import Final

import msgspec

from swarmctl.connect import Link
from swarmware.errors import NoAnswer
from swarmware.module import BoardReader, BoardSet
from swarmware.types.mission import MissionState

STATE: Final = "mission/state"
GOOD: Final = "done"
ENDED: Final = frozenset({GOOD, "failed", "aborted"})
"""States that a mission does not leave."""
LOOK_S: Final = 1.0
"""Longest time without a look at the clock, so that a deadline is kept."""


class Outcome(msgspec.Struct, frozen=True):
    """How a mission ended."""

    states: dict[str, str]
    """Last state of each member."""
    in_time: bool

    @property
    def completed(self) -> bool:
        """Every member's mission ended well."""
        return self.in_time and bool(self.states) and all(state == GOOD for state in self.states.values())

    def failure(self) -> str:
        """What went wrong, for people; empty when nothing did."""
        if self.completed:
            return ""
        bad = [f"{name} {state}" for name, state in sorted(self.states.items()) if state != GOOD]
        return ("out of time: " if not self.in_time else "") + (", ".join(bad) or "nobody took part")


class MissionWatch:
    """The mission states of all platforms, as the ground station has them."""

    def __init__(self, own: BoardReader[MissionState], others: BoardSet[MissionState], station: str) -> None:
        self._own = own
        self._others = others
        self._station = station

    @classmethod
    async def open(cls, link: Link) -> "MissionWatch":
        """Begins to watch."""
        module = link.module
        own = await module.reader(STATE, MissionState)
        others = await module.readers(f"/*/{STATE}", MissionState)
        return cls(own, others, module.platform)

    def states(self) -> dict[str, MissionState]:
        """Every platform's newest state."""
        found = {name: value for name, board in self._others.items() if (value := board.value) is not None}
        if (own := self._own.value) is not None:
            found[self._station] = own
        return found

    async def until_known(
        self, platforms: Collection[str], timeout_s: float, on_change: Callable[[int], None]
    ) -> None:
        """Returns when the boards of all these platforms arrive at the ground station.

        Raises: NoAnswer naming those that are missing.
        """
        wanted = set(platforms)
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        while missing := wanted - self.states().keys():
            on_change(len(wanted) - len(missing))
            if asyncio.get_running_loop().time() > deadline_s:
                names = ", ".join(sorted(missing))
                raise NoAnswer(f"{names}: not heard at {self._station}; expected within {timeout_s:g} s")
            await self._change()
        on_change(len(wanted))

    async def until_ended(
        self,
        members: Collection[str],
        epoch: int,
        timeout_s: float,
        on_change: Callable[[Mapping[str, MissionState]], None],
    ) -> Outcome:
        """Returns when the mission of this epoch has ended on all members, or time is up."""
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        while True:
            now = {
                name: state
                for name, state in self.states().items()
                if name in members and state.epoch == epoch
            }
            on_change(now)
            states = {name: now[name].state if name in now else "unknown" for name in members}
            if all(state in ENDED for state in states.values()):
                return Outcome(states, True)
            if asyncio.get_running_loop().time() > deadline_s:
                return Outcome(states, False)
            await self._change()

    async def _change(self) -> None:
        """Waits for news of any platform, the own one included, at most LOOK_S."""
        waits = [
            asyncio.create_task(self._others.changed(LOOK_S), name="others"),
            asyncio.create_task(self._own.changed(LOOK_S), name="own"),
        ]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in waits:
                task.cancel()
            # a wait that ran out is no error here: the caller looks at the clock
            await asyncio.gather(*waits, return_exceptions=True)
