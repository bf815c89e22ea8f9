"""A fenced vehicle as real processes: targets outside are refused, a way out ends in a hold inside."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from tests.patience import PATIENCE_S

from swarmd.hal.config import Config as HalConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.errors import MissionError
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.fence import FenceState
from swarmware.types.mission import ManoeuvreRequest, MissionState, MissionStatus
from swarmware.types.navigation import NavStatus
from swarmware.types.reaction import Reactions
from swarmware.types.vehicle import Pose

NODE = ("sim", "hal", "control", "navigator", "mission")
BAY = {
    "polygon_m": (
        (-45.0, -20.0),
        (0.0, -20.0),
        (0.0, 20.0),
        (-15.0, 20.0),
        (-15.0, -10.0),
        (-28.0, -10.0),
        (-28.0, 20.0),
        (-45.0, 20.0),
    ),
    "max_height_m": 15.0,
}
"""Two legs that are joined in the south; vehicles start in the western one."""


async def order(m: Module, name: str, **params: float) -> MissionStatus:
    request = ManoeuvreRequest(name, params, "test")
    return await m.request("sys/mission/manoeuvre", request, MissionStatus, timeout_s=PATIENCE_S)


def test_vehicle_leaving_fence_holds_inside(tmp_path: Path) -> None:
    async def fly() -> None:
        services: dict[str, Any] = {
            "sim": SimConfig(),
            "hal": HalConfig(),
            "control": {},
            "navigator": {},
            "mission": {"fence": BAY},
        }
        config_dir = make_node(tmp_path, "uav1", services=services)
        async with spawn(config_dir, *NODE), Module("test", config_dir=config_dir) as m:
            fence = m.reader("nav/fence", FenceState)
            truth = m.reader("sim/truth", Pose)
            mission = m.reader("mission/state", MissionState)
            reactions = m.reader("mission/reactions", Reactions)
            status = m.reader("nav/status", NavStatus)

            async def until_fence(inside: bool) -> FenceState:
                async with asyncio.timeout(PATIENCE_S):
                    while (state := fence.value) is None or state.inside is not inside:
                        await fence.changed()
                    return state

            start = await until_fence(True)
            assert (start.exists, start.max_height_m, start.leaving) == (True, 15.0, False)
            with pytest.raises(MissionError, match=r"takeoff.*5.0 m outside the greatest height \(15 m\)"):
                await order(m, "takeoff", altitude_m=20.0)
            await order(m, "takeoff", altitude_m=5.0)
            async with asyncio.timeout(PATIENCE_S):
                while mission.value is None or mission.value.state != "done":
                    await mission.changed()
            with pytest.raises(MissionError, match=r"goto: .*outside the boundary of the fence"):
                await order(m, "goto", x_m=-20.0, y_m=5.0)

            await order(m, "goto", x_m=-8.0, y_m=0.0, speed_m_s=3.0)
            async with asyncio.timeout(PATIENCE_S):
                while not any(row.row == "fence" and row.phase == "active" for row in rows(reactions.value)):
                    await reactions.changed()
                while status.value is None or status.value.state != "holding":
                    assert fence.value is not None
                    assert fence.value.inside
                    await status.changed()
            held = truth.value
            assert held is not None
            assert held.x_m < -28.0, "it stands before the boundary"
            assert held.z_m == pytest.approx(5.0, abs=1.0)
            row = next(row for row in rows(reactions.value) if row.row == "fence")
            assert (row.action, row.reason) in {("hold", "leaving the fence"), ("hold", "")}

            await order(m, "goto", x_m=-36.0, y_m=0.0, speed_m_s=2.0)
            async with asyncio.timeout(PATIENCE_S):
                while truth.value is None or truth.value.x_m > -35.0:
                    await truth.changed()

    def rows(value: Reactions | None) -> tuple:  # type: ignore[type-arg]
        return () if value is None else value.rows

    with no_leaks(tmp_path):
        asyncio.run(fly())
