"""The driver of an airframe: sensors and set-points in, outputs at each inertial sample, gains by order."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from tests.unit.hal.flight.frames import airframe

from swarmd.hal.config import ChassisConfig, Config
from swarmd.hal.core.flight.flight_core import FlightTiming
from swarmd.hal.core.flight.hover_controller import MultirotorController
from swarmd.hal.core.flight.mixer import IDLE
from swarmd.hal.driver import Site
from swarmd.hal.drivers.sim import make
from swarmd.hal.flight_controller import FlightController
from swarmware.errors import Denied
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.control import Drive
from swarmware.types.flight_record import FlightRecord
from swarmware.types.scalar import Float
from swarmware.types.vehicle import GnssFix, Imu

IMU = "test/imu"
STILL = Imu(0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0)
MS = 1_000_000


class Bench(FlightController):
    """Motors on the bench, whose controllers execute each order."""

    def __init__(self, **config: float) -> None:
        made = msgspec.convert(config, ChassisConfig)
        super().__init__("bench", made, MultirotorController(airframe()), FlightTiming(), IMU, 20.0)
        self.sent: list[ActuatorOutputs] = []
        self.carried: list[ChassisAction] = []

    def send_outputs(self, outputs: ActuatorOutputs, stamp_ns: int) -> None:
        self.sent.append(outputs)

    def carry_order(self, order: ChassisOrder) -> None:
        self.carried.append(order.action)
        self.report_as(armed=order.action is ChassisAction.ARM, answered=order.number)

    def report_as(self, *, armed: bool, landed: bool = True, answered: int = 0) -> None:
        assert self.module is not None
        self.on_report(ChassisReport(armed, landed, answered), self.module.now_ns())


@asynccontextmanager
async def bench(root: Path, **config: float) -> AsyncIterator[tuple[Bench, Module, Module]]:
    async with tmp_node(root) as node, Module("hal", node=node) as module, Module("test", node=node) as other:
        driver = Bench(**config)
        await driver.open(module)
        try:
            yield driver, module, other
        finally:
            await driver.close()


async def test_each_inertial_sample_is_answered_by_outputs_once(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, module, other):
        imu = other.writer(IMU, Imu)
        driver.report_as(armed=False)
        assert not await driver.write(module.now_ns())
        imu.write(STILL)
        assert await driver.write(module.now_ns())
        assert not await driver.write(module.now_ns())
        assert driver.sent == [ActuatorOutputs()]
        await driver.execute(ChassisAction.ARM)
        imu.write(STILL)
        assert await driver.write(module.now_ns())
        assert driver.sent[-1].motors == (IDLE,) * 4
        assert driver.carried == [ChassisAction.ARM]


async def test_set_point_that_control_lets_through_lifts_it(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, module, other):
        imu, drives = other.writer(IMU, Imu), other.writer("act/drive", Drive)
        fixes, heights = other.writer("sensor/gnss", GnssFix), other.writer("sensor/height", Float)
        driver.report_as(armed=True)
        fixes.write(GnssFix(48.0, 11.0, 500.0, 0.03, 12))
        heights.write(Float(0.0))
        drives.write(Drive(0.0, 0.0, 1.0))
        imu.write(STILL)
        await driver.write(module.now_ns())
        thrust_n = sum(airframe().motor.thrust_max_n * output**2 for output in driver.sent[-1].motors)
        assert thrust_n > airframe().hover_thrust_n


async def test_control_period_is_longer_at_rest(tmp_path: Path) -> None:
    async with bench(tmp_path, rest_hz=5.0) as (driver, module, _):
        assert driver.period_s == 0.01
        driver.report_as(armed=False)
        await driver.write(module.now_ns())
        assert driver.period_s == 0.2
        driver.report_as(armed=True)
        await driver.write(module.now_ns())
        assert driver.period_s == 0.01


async def test_subscribers_get_mean_samples_with_attitude(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, module, other):
        imu, mean = other.writer(IMU, Imu), other.reader("sensor/imu", Imu)
        driver.report_as(armed=True)
        found: list[Imu] = []
        start_ns = module.now_ns()
        for tick in range(1, 101):
            now_ns = start_ns + tick * 10 * MS
            imu.write(STILL, now_ns)
            await driver.write(now_ns)
            if mean.value is not None and (not found or mean.value is not found[-1]):
                found.append(mean.value)
        assert len(found) == pytest.approx(20, abs=1)
        assert found[-1].roll_rad == pytest.approx(0.0, abs=1e-6)
        assert found[-1].az_m_s2 == pytest.approx(GRAVITY_M_S2)


async def test_gains_of_own_controllers_need_no_device(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, _, _):
        driver.report_as(armed=True, landed=False)
        state = await driver.execute(ChassisAction.GAINS, {"rate_kp_1_s": 9.5})
        assert (state.armed, state.landed) == (True, False)
        with pytest.raises(Denied, match="gain 'kp': unknown to this airframe"):
            await driver.execute(ChassisAction.GAINS, {"kp": 1.0})
        assert driver.carried == []


async def test_armed_vehicle_without_inertial_samples_is_fail_safe(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, module, other):
        imu = other.writer(IMU, Imu)
        imu.write(STILL)
        driver.report_as(armed=True)
        now_ns = module.now_ns()
        await driver.write(now_ns)
        assert "no inertial samples" not in driver.failsafe(now_ns)
        assert "no inertial samples in test/imu" in driver.failsafe(now_ns + 300 * MS)
        driver.report_as(armed=False)
        assert driver.failsafe(now_ns + 300 * MS) == ""


def test_chassis_with_airframe_is_flight_controller() -> None:
    names = {device.name: device for device in make(Config(), Site(PlatformKind.UAV, "", airframe()))}
    assert names.keys() == {"sim.gnss", "sim.range", "sim.battery", "sim.sonar", "sim.flight"}
    assert names["sim.flight"].period_s == 0.01
    level = {device.name for device in make(Config(), Site(PlatformKind.UAV, ""))}
    assert level == {"sim.gnss", "sim.imu", "sim.range", "sim.battery", "sim.sonar", "sim.chassis"}


async def test_flight_error_is_recorded_with_vehicle_action(tmp_path: Path) -> None:
    async with bench(tmp_path) as (driver, module, other):
        imu, records = other.writer(IMU, Imu), other.stream_reader("vehicle/flight_record", FlightRecord)
        driver.report_as(armed=True, landed=False)
        start_ns = module.now_ns()
        for ms in [*range(0, 1000, 10), *range(1700, 3800, 10)]:
            imu.write(STILL, start_ns + ms * MS)
            driver.on_report(ChassisReport(True, False), start_ns + ms * MS)
            await driver.write(start_ns + ms * MS)
            driver.conditions(start_ns + ms * MS)
        async with asyncio.timeout(20.0):
            record = await anext(aiter(records))
        assert record.reason == "flight/loop away"
        assert max(row.gap_s for row in record.rows) == pytest.approx(0.71)
        assert len(record.rows[0].motors) == 4
        assert record.rows[-1].stamp_ns == pytest.approx(start_ns + 3700 * MS, abs=100 * MS)
