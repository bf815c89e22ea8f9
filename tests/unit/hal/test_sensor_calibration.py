"""The calibration of an inertial unit by request: applied, kept over restarts, refused in motion."""

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from unittest.mock import patch

import pytest

from swarmd.hal.config import Config
from swarmd.hal.core.imu_calibration import FACES
from swarmd.hal.drivers.sim import SimImu
from swarmd.hal.service import Hal
from swarmware.errors import Denied
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import SensorCalibrated, SensorCalibration, SensorCalibrationKind
from swarmware.types.vehicle import Imu, VehicleState

FAST = Config(drivers=(), retry_s=0.05, report_hz=50.0)
BIASED = Imu(0.02, -0.03, 0.01, 0.0, 0.0, GRAVITY_M_S2, 0.4)
WINDOW_NS = 400_000_000


def unit() -> SimImu:
    return SimImu("imu", "sensor/imu", Imu, 200.0, 200.0)


@asynccontextmanager
async def serving(node: Node) -> AsyncIterator[None]:
    """The service with a simulated unit, on a node."""
    async with Module("hal", node=node) as module:
        with patch("swarmd.hal.service.make_all", return_value=[unit()]):
            task = asyncio.create_task(Hal(module, FAST).run(), name="hal")
            try:
                yield
            finally:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task


@asynccontextmanager
async def measuring(root: Path, sample: list[Imu]) -> AsyncIterator[Module]:
    """Runs a node whose unit repeats the first of these samples; yields a module of the node."""
    async with tmp_node(root) as node, Module("test", node=node) as other:
        source = other.writer("sim/sensors/imu", Imu)

        async def measure() -> None:
            async for _ in other.every(0.005):
                source.write(sample[0])

        task = other.start(measure(), "unit")
        with patch("swarmd.hal.sensor_calibration.WINDOW_NS", WINDOW_NS):
            yield other
        task.cancel()


@asynccontextmanager
async def calibrating(root: Path, sample: list[Imu]) -> AsyncIterator[Module]:
    async with measuring(root, sample) as other, serving(other.node):
        yield other


async def ask(other: Module, kind: SensorCalibrationKind, **fields: object) -> SensorCalibrated:
    request = SensorCalibration("uav1", kind, **fields)  # type: ignore[arg-type]  # by name
    while True:
        try:
            return await other.request(
                "sys/vehicle/calibrate_sensor", request, SensorCalibrated, timeout_s=20.0
            )
        except Denied as reason:  # on a busy computer a window has too few samples: asked again
            if "samples of the inertial unit" not in str(reason):
                raise


async def until_rate(other: Module, wanted: float) -> None:
    board = other.reader("sensor/imu", Imu)
    async with asyncio.timeout(20.0):
        while abs((await board.changed()).wx_rad_s - wanted) > 1e-6:
            pass


async def test_bias_is_subtracted_after_restart_until_reset(tmp_path: Path) -> None:
    async with measuring(tmp_path, [BIASED]) as other:
        async with serving(other.node):
            await until_rate(other, 0.02)
            found = await ask(other, SensorCalibrationKind.GYRO)
            assert (found.driver, found.text) == ("sim.imu", "bias 0.0200, -0.0300, 0.0100 rad/s")
            await until_rate(other, 0.0)
        async with serving(other.node):
            turned = await ask(other, SensorCalibrationKind.COMPASS, heading_rad=0.4 + math.radians(10.0))
            assert turned.text == "heading corrected by 10.0°"
            await until_rate(other, 0.0)
            await ask(other, SensorCalibrationKind.RESET)
            await until_rate(other, 0.02)


async def test_accelerometer_takes_six_requests_and_lists_missing(tmp_path: Path) -> None:
    sample = [BIASED]
    async with calibrating(tmp_path, sample) as other:
        left = set(FACES.values())
        for (axis, sign), name in FACES.items():
            force = [0.1, 0.1, 0.1]
            force[axis] += sign * GRAVITY_M_S2
            sample[0] = Imu(0.0, 0.0, 0.0, *force)
            await until_force(other, force)
            found = await ask(other, SensorCalibrationKind.ACCELEROMETER)
            left -= {name}
            assert set(found.missing) == left
            assert found.text.startswith(f"{name} taken" if left else "offset 0.1000, 0.1000, 0.1000 m/s²")


async def until_force(other: Module, force: list[float]) -> None:
    board = other.reader("sensor/imu", Imu)
    async with asyncio.timeout(20.0):
        while (found := await board.changed(), [found.ax_m_s2, found.ay_m_s2, found.az_m_s2])[1] != force:
            pass


async def test_armed_misnamed_or_busy_vehicle_refuses_calibration(tmp_path: Path) -> None:
    async with calibrating(tmp_path, [BIASED]) as other:
        await until_rate(other, 0.02)
        vehicle = other.writer("vehicle/state", VehicleState)
        vehicle.write(VehicleState(True, True))
        with pytest.raises(Denied, match="expected a vehicle that is disarmed and on the ground"):
            await ask(other, SensorCalibrationKind.GYRO)
        vehicle.write(VehicleState(False, True))
        with pytest.raises(Denied, match=r"driver 'gyro9': no inertial unit; expected one of: sim\.imu"):
            await ask(other, SensorCalibrationKind.GYRO, driver="gyro9")
        with pytest.raises(Denied, match="expected the true heading"):
            await ask(other, SensorCalibrationKind.COMPASS)
        misnamed = SensorCalibration("uav2", SensorCalibrationKind.GYRO)
        with pytest.raises(Denied, match="this is uav1; expected its own name"):
            await other.request("sys/vehicle/calibrate_sensor", misnamed, SensorCalibrated)
        first = asyncio.create_task(ask(other, SensorCalibrationKind.GYRO))
        second = asyncio.create_task(ask(other, SensorCalibrationKind.GYRO))
        results = await asyncio.gather(first, second, return_exceptions=True)
        refused = [one for one in results if isinstance(one, Denied)]
        assert len(refused) == 1
        assert "another one is in progress" in str(refused[0])


async def test_a_damaged_file_corrects_nothing_and_is_replaced(tmp_path: Path) -> None:
    async with measuring(tmp_path, [BIASED]) as other:
        file = paths.imu_calibration(other.node.config.data_path)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text('{"sim.imu": {"gyro_bias_rad_s": 7}}')
        async with serving(other.node):
            await until_rate(other, 0.02)
            await ask(other, SensorCalibrationKind.GYRO)
            await until_rate(other, 0.0)
