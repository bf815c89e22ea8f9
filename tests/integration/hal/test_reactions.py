"""Reactions of a vehicle as real processes: its battery runs down in the air."""

import asyncio
import math
from itertools import pairwise
from pathlib import Path

import pytest
from tests.integration.hal.nodes import VEHICLE, node
from tests.patience import PATIENCE_S

from swarmd.sim.config import BatteryConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.types.mission import ManoeuvreRequest, MissionProgress, MissionState, MissionStatus
from swarmware.types.navigation import Collision
from swarmware.types.reaction import Reactions
from swarmware.types.rpc import Empty
from swarmware.types.vehicle import BatteryState, Pose, VehicleState

MANOEUVRE = "sys/mission/manoeuvre"
CAPACITY_WH = 8.0
"""Hovering draws 180 W: 0.6 % of the charge a second; it is low at 30 %, some seconds after the arrival."""
RESERVE_RATIO = 0.05


@pytest.mark.parametrize(
    ("away_m", "start_ratio", "action"),
    [(5.0, 0.39, "return"), (45.0, 0.5, "land")],
)
def test_vehicle_whose_battery_runs_down_lands_with_reserve(
    tmp_path: Path, away_m: float, start_ratio: float, action: str
) -> None:
    async def fly() -> None:
        sim = SimConfig(battery=BatteryConfig(capacity_wh=CAPACITY_WH, start_ratio=start_ratio))
        config_dir = node(tmp_path, "uav1", sim)
        services = (*VEHICLE, "health", "mission")
        async with spawn(config_dir, *services), Module("test", config_dir=config_dir) as m:
            truth = m.reader("sim/truth", Pose)
            battery = m.reader("power/battery", BatteryState)
            state = m.reader("vehicle/state", VehicleState)
            mission = m.reader("mission/state", MissionState)
            reactions = m.reader("mission/reactions", Reactions)
            collisions = m.stream_reader("sim/collision", Collision)
            steps = m.stream_reader("mission/progress", MissionProgress)
            await m.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
            home = await truth.changed(timeout_s=PATIENCE_S)
            place = {"x_m": home.x_m, "y_m": home.y_m + away_m, "speed_m_s": 4.0}
            for name, params in (("takeoff", {"altitude_m": 5.0}), ("goto", place)):
                request = ManoeuvreRequest(name, params, "test")
                await m.request(MANOEUVRE, request, MissionStatus, timeout_s=PATIENCE_S)
                await until(mission, name)
            # nothing more is ordered: the battery runs down
            async with asyncio.timeout(2 * PATIENCE_S):
                while phase(reactions.value, "battery_low") != "active":
                    await reactions.changed()
                row = next(one for one in (await status(m)).reactions if one.row == "battery_low")
                assert (row.action, row.reason[:11]) == (action, "battery low")
                heights = [(truth.value or home).z_m]
                while state.value is None or state.value.armed:
                    heights.append((await truth.changed()).z_m)
            landed, left = truth.value, battery.value
            assert landed is not None
            assert left is not None
            assert landed.z_m == pytest.approx(0.0, abs=0.1)
            assert left.remaining_ratio >= RESERVE_RATIO
            at_home_m = math.dist((landed.x_m, landed.y_m), (home.x_m, home.y_m))
            assert (at_home_m < 1.0) is (action == "return")
            falls = [before - after for before, after in pairwise(heights)]
            assert max(falls) < 0.5, "it came down in order"
            assert collisions.take() is None
            found = []
            while (step := steps.take()) is not None:
                found += [f"{step.block} {step.event}"] if step.type == "Reaction" else []
            assert found[0] == f"@battery_low active:{action}"

    with no_leaks():
        asyncio.run(fly())


def test_vehicle_whose_mission_daemon_dies_in_air_lands(tmp_path: Path) -> None:
    async def fly() -> None:
        config_dir = node(tmp_path, "uav1")
        async with spawn(config_dir, *VEHICLE, "health"), Module("test", config_dir=config_dir) as m:
            state = m.reader("vehicle/state", VehicleState)
            mission = m.reader("mission/state", MissionState)
            await m.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
            async with spawn(config_dir, "mission") as first:
                request = ManoeuvreRequest("takeoff", {"altitude_m": 3.0}, "test")
                await m.request(MANOEUVRE, request, MissionStatus, timeout_s=PATIENCE_S)
                await until(mission, "takeoff")
                await first.kill()
            async with spawn(config_dir, "mission"), asyncio.timeout(PATIENCE_S):
                while state.value is None or state.value.armed:
                    await state.changed()
                await until(mission, "land")
                reactions = m.reader("mission/reactions", Reactions)
                while phase(reactions.value, "mission_restarted") != "idle":
                    await reactions.changed()
                assert mission.value is not None
                assert mission.value.text == "the mission daemon was restarted while the vehicle was armed"

    with no_leaks():
        asyncio.run(fly())


async def until(mission: BoardReader[MissionState], manoeuvre: str) -> None:
    """Waits for the end of a manoeuvre."""
    async with asyncio.timeout(PATIENCE_S):
        while (found := mission.value) is None or (found.mission, found.state) != (manoeuvre, "done"):
            await mission.changed()


async def status(m: Module) -> MissionStatus:
    return await m.request("sys/mission/status", Empty(), MissionStatus, timeout_s=PATIENCE_S)


def phase(reactions: Reactions | None, row: str) -> str:
    rows = () if reactions is None else reactions.rows
    return next((one.phase.value for one in rows if one.row == row), "")
