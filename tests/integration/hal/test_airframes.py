"""A helicopter and an aircraft as real processes: the same daemons, another airframe in node.toml."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmd.hal.config import Config as HalConfig
from swarmd.navigator.config import Config as NavigatorConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.geometry.attitude import to_euler
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.navigation import Goal, GoalKind, NavStatus
from swarmware.types.vehicle import ArmRequest, Pose, VehicleState

VEHICLE = ("sim", "hal", "control", "navigator")
WORLD = "airfield"


async def until(
    board: BoardReader[NavStatus], right: Callable[[NavStatus], bool], timeout_s: float = 60.0
) -> None:
    async with asyncio.timeout(timeout_s):
        while board.value is None or not right(board.value):
            await board.changed()


@pytest.mark.parametrize(
    ("airframe", "height_m", "place"), [("helicopter", 4.0, (-17.0, 3.0)), ("fixed_wing", 20.0, (0.0, 0.0))]
)
def test_airframe_takes_off_reaches_place_and_holds(
    tmp_path: Path, airframe: str, height_m: float, place: tuple[float, float]
) -> None:
    """Flies both airframes: the fixed wing holds place and height on its circle, the helicopter also
    lands."""
    circles = airframe == "fixed_wing"

    async def fly() -> None:
        services = {
            "sim": SimConfig(world=WORLD),
            "hal": HalConfig(),
            "navigator": NavigatorConfig(world=WORLD),
        }
        config_dir = make_node(tmp_path, "uav1", services=services, airframe=airframe)
        async with spawn(config_dir, *VEHICLE), Module("test", config_dir=config_dir) as m:
            goals = m.writer("nav/goal", Goal)
            status = m.reader("nav/status", NavStatus)
            truth = m.reader("sim/truth", Pose)
            await m.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
            assert (
                await m.request("sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
            ).armed
            goals.write(Goal(1, GoalKind.TAKEOFF, z_m=height_m, speed_m_s=3.0 if circles else 1.5))
            await until(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
            goals.write(Goal(2, GoalKind.GOTO, *place, height_m, speed_m_s=20.0 if circles else 2.0))
            await until(status, lambda s: s.goal_seq == 2 and s.state == "arrived")
            goals.write(Goal(3, GoalKind.HOLD))
            await until(status, lambda s: s.goal_seq == 3 and s.state == "holding")
            here = truth.value
            assert here is not None
            assert here.z_m == pytest.approx(height_m, abs=7.0 if circles else 1.0)
            roll, _, _ = to_euler((here.qx, here.qy, here.qz, here.qw))
            speed = math.hypot(here.vx_m_s, here.vy_m_s)
            if circles:
                assert speed > 15.0
                return
            assert speed < 0.8
            assert abs(roll) < 0.15
            assert math.dist((here.x_m, here.y_m), place) < 1.5
            goals.write(Goal(4, GoalKind.LAND, speed_m_s=1.0))
            await until(status, lambda s: s.goal_seq == 4 and s.state == "arrived")
            assert (
                await m.request("sys/vehicle/arm", ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)
            ).landed

    with no_leaks(tmp_path):
        asyncio.run(fly())
