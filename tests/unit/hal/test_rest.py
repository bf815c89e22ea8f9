"""Simulated devices are read less often while the vehicle rests, and each value in its own period."""

import asyncio
from pathlib import Path

import pytest

from swarmd.hal.config import Config
from swarmd.hal.driver import Sensor, Site
from swarmd.hal.drivers.sim import make
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.vehicle import Imu, VehicleState

FAST = ("sim.imu", "sim.sonar")


@pytest.mark.parametrize(
    ("state", "period_s"),
    [
        (VehicleState(armed=False, landed=True), 0.2),
        (VehicleState(armed=True, landed=True), 0.05),
        (VehicleState(armed=False, landed=False), 0.05),
        (None, 0.05),
    ],
)
async def test_devices_are_read_faster_before_motion(
    tmp_path: Path, state: VehicleState | None, period_s: float
) -> None:
    async with tmp_node(tmp_path, platform="uav1") as node, Module("hal", node=node) as module:
        vehicle = module.writer("vehicle/state", VehicleState)
        if state is not None:
            vehicle.write(state)
        drivers = {
            driver.name: driver
            for driver in make(Config(), Site(PlatformKind.UAV, ""))
            if isinstance(driver, Sensor)
        }
        for driver in drivers.values():
            await driver.open(module)
            await driver.read(module.now_ns())
        assert {name: drivers[name].period_s for name in FAST} == dict.fromkeys(FAST, period_s)
        assert drivers["sim.gnss"].period_s == max(period_s, 0.1)
        assert drivers["sim.battery"].period_s == 1.0
        for driver in drivers.values():
            await driver.close()


async def test_value_later_than_driver_joins_same_period(tmp_path: Path) -> None:
    async with tmp_node(tmp_path, platform="uav1") as node, Module("hal", node=node) as module:
        simulated = module.writer("sim/sensors/imu", Imu)
        (driver,) = [one for one in make(Config(), Site(PlatformKind.UAV, "")) if one.name == "sim.imu"]
        assert isinstance(driver, Sensor)
        await driver.open(module)
        imu = Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.8, 0.0)
        simulated.write(imu)
        assert await driver.read(module.now_ns())
        assert not await driver.read(module.now_ns()), "each value once"
        reading = asyncio.create_task(driver.read(module.now_ns()))
        await asyncio.sleep(0)
        simulated.write(imu)
        assert await reading
        await driver.close()
