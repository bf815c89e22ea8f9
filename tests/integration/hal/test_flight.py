"""A node with an airframe as real processes: flown by the flight controller, killed in the air."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmd.hal.config import Config as HalConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.errors import Denied, SwarmError
from swarmware.geometry.attitude import to_euler
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.chassis import GainsRequest
from swarmware.types.vehicle import (
    ArmRequest,
    DriverTable,
    Goal,
    GoalKind,
    Imu,
    KillRequest,
    NavStatus,
    Pose,
    VehicleState,
)

VEHICLE = ("sim", "hal", "control", "navigator")


async def until(
    board: BoardReader[NavStatus], right: Callable[[NavStatus], bool], timeout_s: float = PATIENCE_S
) -> None:
    async with asyncio.timeout(timeout_s):
        while board.value is None or not right(board.value):
            await board.changed()


def test_an_unknown_airframe_is_refused_by_the_simulation_with_the_known_ones(tmp_path: Path) -> None:
    async def start() -> None:
        config_dir = make_node(tmp_path, "uav1", services={"sim": SimConfig()}, airframe="quad")
        with pytest.raises(SwarmError, match=r"no airframe 'quad'; expected one of .*quad_1k5"):
            async with spawn(config_dir, "sim"):
                pass

    asyncio.run(start())


def test_a_quadrotor_takes_off_holds_and_lands_and_falls_when_it_is_killed(tmp_path: Path) -> None:
    async def fly() -> None:
        services = {"sim": SimConfig(), "hal": HalConfig()}
        config_dir = make_node(tmp_path, "uav1", services=services, airframe="quad_1k5")
        async with spawn(config_dir, *VEHICLE), Module("test", config_dir=config_dir) as m:
            goals = m.writer("nav/goal", Goal)
            status = m.reader("nav/status", NavStatus)
            truth = m.reader("sim/truth", Pose)
            drivers = m.reader("hal/drivers", DriverTable)
            state = m.reader("vehicle/state", VehicleState)
            await m.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
            assert (
                await m.request("sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
            ).armed
            goals.write(Goal(1, GoalKind.TAKEOFF, z_m=3.0, speed_m_s=1.5))
            await until(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
            goals.write(Goal(2, GoalKind.HOLD))
            await m.request(
                "sys/vehicle/gains",
                GainsRequest({"velocity_kp_1_s": 1.6}),
                VehicleState,
                timeout_s=PATIENCE_S,
            )
            with pytest.raises(Denied, match="gain 'p': unknown to this airframe; expected one of rate_kp"):
                await m.request(
                    "sys/vehicle/gains", GainsRequest({"p": 1.0}), VehicleState, timeout_s=PATIENCE_S
                )
            await until(status, lambda s: s.goal_seq == 2 and s.state == "holding")
            imu = m.reader("sensor/imu", Imu)
            assert (await imu.changed(timeout_s=PATIENCE_S)).roll_rad is not None
            await drivers.changed(timeout_s=PATIENCE_S)
            async with asyncio.timeout(PATIENCE_S):
                while True:  # a busy computer is slower now and then
                    table = await drivers.changed()
                    (found,) = (driver for driver in table.drivers if driver.name == "sim.flight")
                    if found.real_hz > 50.0:
                        break
            assert (found.state, found.asked_hz, found.actuator) == ("running", 100.0, True)
            here = truth.value
            assert here is not None
            assert here.z_m == pytest.approx(3.0, abs=0.6)
            assert max(map(abs, to_euler((here.qx, here.qy, here.qz, here.qw))[:2])) < 0.2
            goals.write(Goal(3, GoalKind.LAND))
            await until(status, lambda s: s.goal_seq == 3 and s.state == "arrived")
            assert (
                await m.request("sys/vehicle/arm", ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)
            ).landed

            assert (
                await m.request("sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
            ).armed
            goals.write(Goal(4, GoalKind.TAKEOFF, z_m=4.0, speed_m_s=2.0))
            await until(status, lambda s: s.goal_seq == 4 and s.state == "arrived")
            dead = await m.request(
                "sys/vehicle/kill", KillRequest("uav1", "test"), VehicleState, timeout_s=PATIENCE_S
            )
            assert (dead.armed, dead.landed) == (False, False)
            async with asyncio.timeout(PATIENCE_S):
                while state.value is None or not state.value.landed:
                    await state.changed()

    with no_leaks(tmp_path):
        asyncio.run(fly())
