"""Delays the choice of members until the platforms in reach have published their first state."""

from collections.abc import Callable

from swarmd.mission.core.census import FIRST_STATE_NS, Census
from swarmware.module.wakeup import Wakeup
from swarmware.runtime.core import HardwareClock


class FirstStates:
    """Waits for first states, three seconds at most: a swarm that has just started is not yet complete."""

    def __init__(
        self, census: Census, clock: HardwareClock, refresh: Callable[[], None], *, is_station: bool
    ) -> None:
        """`refresh`: reports the platforms in reach to the census; `is_station`: this node plays no role,
        so it waits for the first other platform, too."""
        self._census = census
        self._clock = clock
        self._refresh = refresh
        self._alone_until_ns = clock.now_ns() + FIRST_STATE_NS if is_station else 0
        self._taken = Wakeup()

    def on_states(self) -> None:
        """States of other platforms have arrived."""
        self._taken.notify()

    async def wait(self) -> None:
        """Return when no first state is awaited any more, or after three seconds."""
        ends_ns = self._clock.now_ns() + FIRST_STATE_NS
        while True:
            self._refresh()
            now_ns = self._clock.now_ns()
            until_ns = self._census.first_state_until_ns(now_ns)
            if not self._census.has_states:
                until_ns = max(until_ns, self._alone_until_ns)
            left_ns = min(until_ns, ends_ns) - now_ns
            if left_ns <= 0:
                return
            await self._taken.wait(left_ns / 1e9)
