"""A ground station misses a vehicle that was killed: two nodes of real processes over loopback."""

import asyncio
from pathlib import Path

from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.root import make_swarm
from swarmware.types.health import Fault, HealthState, Phase
from swarmware.types.net import Routes


async def until_reached(routes: BoardReader[Routes], platform: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while routes.value is None or platform not in {route.platform for route in routes.value.routes}:
            await routes.changed()


async def fault(faults: StreamReader[Fault], check: str) -> Fault:
    """The next change of the fault of this check."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            if (found := await faults.next()).check == check:
                return found


async def shown(state: BoardReader[HealthState], faults: tuple[str, ...]) -> HealthState:
    """The state of the ground station as soon as these are its confirmed faults."""
    async with asyncio.timeout(PATIENCE_S):
        while (now := state.value) is None or now.faults != faults:
            await state.changed()
    return now


async def test_killed_vehicle_is_ground_station_fault_until_return(tmp_path: Path) -> None:
    make_swarm(tmp_path / "keys", {"gcs": "operator", "uav1": "node"})
    broker = {"udp_port": free_port(), "bind_address": "127.0.0.1"}
    health = {"look_hz": 10.0, "clear_s": 0.5}
    station, vehicle = (
        make_node(tmp_path, name, kind=kind, services=services, keys_dir=str(tmp_path / "keys" / name))
        for name, kind, services in (
            ("gcs", "gcs", {"broker": broker, "health": health}),
            ("uav1", "uav", {"broker": broker}),
        )
    )
    with no_leaks(tmp_path / "gcs/run", tmp_path / "gcs/shm"):
        async with spawn(station, "broker", "health"), Module("probe", config_dir=station) as probe:
            faults = probe.stream_reader("health/faults", Fault)
            routes = probe.reader("net/routes", Routes)
            state = probe.reader("health/state", HealthState)
            async with spawn(vehicle, "broker") as process:
                await until_reached(routes, "uav1")
                assert (await shown(state, ())).level == "ok"
                await process.kill()
            lost = await fault(faults, "platform/uav1")
            assert (lost.phase, lost.state, lost.level) == (Phase.CONFIRMED, "lost", "warn")
            assert (await shown(state, ("platform/uav1=lost",))).level == "warn"
            async with spawn(vehicle, "broker"):
                assert (await fault(faults, "platform/uav1")).phase is Phase.HEALED
                assert (await fault(faults, "platform/uav1")).phase is Phase.CLEARED
                await shown(state, ())
