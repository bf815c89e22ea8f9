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
from swarmware.model import paths
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.chassis import GainsRequest
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReports
from swarmware.types.navigation import Goal, GoalKind, NavStatus
from swarmware.types.vehicle import ArmRequest, Imu, KillRequest, Pose, VehicleState

VEHICLE = ("sim", "hal", "control", "navigator")


async def until(
    board: BoardReader[NavStatus], right: Callable[[NavStatus], bool], timeout_s: float = PATIENCE_S
) -> None:
    try:
        async with asyncio.timeout(timeout_s):
            while board.value is None or not right(board.value):
                await board.changed()
    except TimeoutError:
        raise AssertionError(f"still {board.value} after {timeout_s:.0f} s") from None


TAKEOFFS = 3
"""Take-offs that are tried: on a busy computer the control loop may starve until the vehicle touches the
ground."""


class Pilot:
    """Orders one flight; a vehicle that touched the ground in a take-off is disarmed and started again."""

    def __init__(self, m: Module) -> None:
        self._goals = m.writer("nav/goal", Goal)
        self.status = m.reader("nav/status", NavStatus)
        self.state = m.reader("vehicle/state", VehicleState)
        self._checks = m.reader(paths.checks("hal", 1), CheckReports)
        self._m = m
        self._goal_seq = 0

    async def arm(self, armed: bool) -> VehicleState:
        return await self._m.request("sys/vehicle/arm", ArmRequest(armed), VehicleState, timeout_s=PATIENCE_S)

    def order(self, kind: GoalKind, z_m: float = 0.0, speed_m_s: float = 1.5) -> None:
        self._goal_seq += 1
        self._goals.write(Goal(self._goal_seq, kind, z_m=z_m, speed_m_s=speed_m_s))

    async def reached(self, state: str) -> None:
        await until(self.status, lambda s: s.goal_seq == self._goal_seq and s.state == state)

    def _touched(self) -> bool:
        reports = self._checks.value
        return reports is not None and any(
            report.check == "hal/flight/contact" and report.state == "touched" for report in reports.reports
        )

    async def take_off(self, z_m: float, speed_m_s: float) -> None:
        for _ in range(TAKEOFFS):
            await until(self.status, lambda _: not self._touched())
            assert (await self.arm(True)).armed
            self.order(GoalKind.TAKEOFF, z_m, speed_m_s)
            await until(
                self.status,
                lambda s: self._touched() or (s.goal_seq == self._goal_seq and s.state == "arrived"),
            )
            if not self._touched():
                return
            await until(self.status, lambda _: self.state.value is not None and self.state.value.landed)
            await self.arm(False)
        raise AssertionError(f"{TAKEOFFS} take-offs ended on the ground")


def test_unknown_airframe_is_refused_with_known_names(tmp_path: Path) -> None:
    async def start() -> None:
        config_dir = make_node(tmp_path, "uav1", services={"sim": SimConfig()}, airframe="quad")
        with pytest.raises(SwarmError, match=r"no airframe 'quad'; expected one of .*quad_1k5"):
            async with spawn(config_dir, "sim"):
                pass

    asyncio.run(start())


def test_quadrotor_flies_and_falls_when_killed(tmp_path: Path) -> None:
    async def fly() -> None:
        services = {"sim": SimConfig(), "hal": HalConfig()}
        config_dir = make_node(tmp_path, "uav1", services=services, airframe="quad_1k5")
        async with spawn(config_dir, *VEHICLE), Module("test", config_dir=config_dir) as m:
            pilot = Pilot(m)
            truth = m.reader("sim/truth", Pose)
            drivers = m.reader("hal/drivers", DriverTable)
            await m.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
            await pilot.take_off(3.0, 1.5)
            pilot.order(GoalKind.HOLD)
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
            await pilot.reached("holding")
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
            pilot.order(GoalKind.LAND)
            await pilot.reached("arrived")
            assert (await pilot.arm(False)).landed

            await pilot.take_off(4.0, 2.0)
            dead = await m.request(
                "sys/vehicle/kill", KillRequest("uav1", "test"), VehicleState, timeout_s=PATIENCE_S
            )
            assert (dead.armed, dead.landed) == (False, False)
            async with asyncio.timeout(PATIENCE_S):
                while pilot.state.value is None or not pilot.state.value.landed:
                    await pilot.state.changed()

    with no_leaks(tmp_path):
        asyncio.run(fly())
