"""A mission that starts with the swarm waits for the states of its platforms, a bounded time."""

import asyncio

from swarmd.mission.core.census import FIRST_STATE_NS, Census
from swarmd.mission.first_states import FirstStates
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState

S = 1_000_000_000
IDLE = MissionState(0, "", MissionPhase.IDLE, kind=PlatformKind.UAV)


class SettableClock:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.ns = 100 * S

    def now_ns(self) -> int:
        return self.ns

    def to_mono_ns(self, stamp_ns: int) -> int:
        return stamp_ns


class Rig:
    """A node whose routes the test states."""

    def __init__(self, *, is_station: bool = False) -> None:
        self.clock = SettableClock()
        self.census = Census("gcs", 3 * S)
        self.reachable: tuple[str, ...] = ()
        self.states = FirstStates(self.census, self.clock, self._refresh, is_station=is_station)

    def _refresh(self) -> None:
        for name in self.reachable:
            self.census.on_reachable(name, self.clock.ns)

    def receive(self, name: str) -> None:
        self.census.on_state(name, IDLE, self.clock.ns)
        self.states.on_states()


async def waits(task: asyncio.Task[None]) -> bool:
    for _ in range(5):
        await asyncio.sleep(0)
    return not task.done()


async def test_daemon_continues_with_last_states_in_reach() -> None:
    rig = Rig()
    rig.reachable = ("uav1", "uav2")
    waiting = asyncio.create_task(rig.states.wait())
    assert await waits(waiting)
    rig.receive("uav1")
    assert await waits(waiting)
    rig.receive("uav2")
    await waiting


async def test_long_stateless_platform_delays_nothing() -> None:
    rig = Rig()
    rig.reachable = ("relay",)
    rig.census.on_reachable("relay", rig.clock.ns - FIRST_STATE_NS)
    await rig.states.wait()


async def test_lone_vehicle_starts_at_once_station_waits() -> None:
    await Rig().states.wait()
    station = Rig(is_station=True)
    waiting = asyncio.create_task(station.states.wait())
    assert await waits(waiting)
    station.receive("uav1")
    await waiting
    later = Rig(is_station=True)
    later.clock.ns += FIRST_STATE_NS
    await later.states.wait()


async def test_it_ends_although_further_platforms_come_into_reach() -> None:
    rig = Rig()
    rig.reachable = ("uav1",)
    waiting = asyncio.create_task(rig.states.wait())
    assert await waits(waiting)
    rig.clock.ns += FIRST_STATE_NS - S
    rig.reachable = ("uav1", "uav2")
    rig.states.on_states()
    assert await waits(waiting)
    rig.clock.ns += S
    rig.states.on_states()
    await waiting
