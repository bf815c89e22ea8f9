"""When the states of other platforms are evaluated: at once in a mission, together without one."""

from collections.abc import Callable
from typing import Final

from swarmware.model.clock import Clock
from swarmware.module.boardset import BoardSet
from swarmware.module.wakeup import Wakeup
from swarmware.runtime.core import next_multiple_ns
from swarmware.runtime.instant import wait_s
from swarmware.types.mission import MissionState

IDLE_NS: Final = 500_000_000
"""Without a mission changes are evaluated at multiples of this: in a swarm of sixteen the heartbeats of the
others come at eight instants a second."""


class MemberStates:
    """Passes changed states of other platforms on; a caller that decides by them calls `take_news` first."""

    def __init__(
        self,
        boards: BoardSet[MissionState],
        clock: Clock,
        idle: Callable[[], bool],
        take: Callable[[tuple[str, ...]], None],
    ) -> None:
        """`idle`: whether this platform plays no mission; `take`: gets the platforms whose state changed."""
        self._boards = boards
        self._clock = clock
        self._idle = idle
        self._take = take
        self._mission_begun = Wakeup()

    async def run(self) -> None:
        """Passes changes on until cancelled."""
        while True:
            self._take(await self._boards.changed())
            if self._idle():
                next_ns = next_multiple_ns(self._clock.now_ns(), IDLE_NS)
                await self._mission_begun.wait(wait_s(self._clock, next_ns))

    def take_news(self) -> None:
        """Pass on what changed and was not passed on yet."""
        if changed := self._boards.news():
            self._take(changed)

    def on_mission(self) -> None:
        """A mission is played from now on."""
        self._mission_begun.notify()
