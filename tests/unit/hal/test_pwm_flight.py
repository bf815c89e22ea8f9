"""The flight controller on motors behind pulses: arming, kill, lost samples, a hanging loop, settings."""

import asyncio
import os
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import msgspec
import pytest
from tests.unit.hal.flight.frames import SHARE, airframe
from tests.unit.hal.pwm_chip import chip, number

from swarmd.hal.config import Config, MotorPulse, PwmFlightDriver, ServoPulse
from swarmd.hal.driver import DeviceGone, Site
from swarmd.hal.drivers.pwm_flight import PwmFlight, make, scheduling
from swarmware.errors import ConfigError, Denied
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.airframe_file import load_airframe
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import ChassisAction
from swarmware.types.control import Drive
from swarmware.types.vehicle import Imu, VehicleState

STILL = Imu(0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0)
SITE = Site(PlatformKind.UAV, "", airframe())
MOTORS = tuple(MotorPulse(channel=index) for index in range(4))
STOP, IDLE = [1000] * 4, [1060] * 4
MS = 1_000_000


def driver(device: Path) -> PwmFlight:
    (made,) = make(Config(pwm_flight=PwmFlightDriver(device=str(device), motors=MOTORS)), SITE)
    assert isinstance(made, PwmFlight)
    return made


class Rig:
    """The driver on a chip of files, its inertial unit, and the commands that control lets through."""

    def __init__(self, driver: PwmFlight, module: Module, other: Module, folder: Path) -> None:
        self.driver, self.module, self.folder = driver, module, folder
        self.imu: BoardWriter[Imu] = other.writer("sensor/imu_raw", Imu)
        self.drives: BoardWriter[Drive] = other.writer("act/drive", Drive)

    @property
    def widths_us(self) -> list[int]:
        """Width of the pulses of each motor."""
        return [number(self.folder / f"pwm{index}", "duty_cycle") // 1000 for index in range(4)]

    @property
    def armed(self) -> bool:
        assert self.driver.state is not None
        return self.driver.state.armed

    async def step(self, count: int = 1) -> None:
        """Publishes a number of samples of a unit at rest."""
        for _ in range(count):
            self.imu.write(STILL)
            await self.driver.write(self.module.now_ns())

    async def arm(self) -> None:
        """Arms the vehicle, again if an overloaded computer made the driver stop the motors."""
        async with asyncio.timeout(20.0):
            while self.widths_us != IDLE:
                await self.step(3)
                with suppress(Denied):
                    await self.driver.execute(ChassisAction.ARM)
                await self.step()

    async def until_stopped(self) -> None:
        await asyncio.to_thread(self.spin_until_stopped)

    def spin_until_stopped(self) -> None:
        end_s = time.monotonic() + 60.0
        while self.widths_us != STOP:
            assert time.monotonic() < end_s


@asynccontextmanager
async def rig(root: Path) -> AsyncIterator[Rig]:
    folder = chip(root, 4)
    one = driver(folder)
    async with tmp_node(root) as node, Module("hal", node=node) as module, Module("test", node=node) as other:
        await one.open(module)
        try:
            yield Rig(one, module, other, folder)
        finally:
            await one.close()


async def test_motors_stand_until_armed_then_lift_vehicle(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        assert r.widths_us == STOP
        assert [number(r.folder / f"pwm{index}", "period") for index in range(4)] == [2_500_000] * 4
        with pytest.raises(Denied, match="no inertial samples"):
            await r.driver.execute(ChassisAction.ARM)
        await r.step(3)
        assert r.widths_us == STOP
        await r.arm()
        r.drives.write(Drive(0.0, 0.0, 1.0))
        await r.step(2)
        assert all(1400 < width < 2000 for width in r.widths_us)
        await r.driver.execute(ChassisAction.DISARM)
        await r.step()
        assert not r.armed
        assert r.widths_us == STOP


async def test_kill_stops_motors_before_next_sample(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await r.arm()
        assert not (await r.driver.execute(ChassisAction.KILL)).armed
        await r.until_stopped()


async def test_motors_stop_and_disarm_without_inertial_samples(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await r.arm()
        now_ns = r.module.now_ns()
        await r.driver.write(now_ns + 800 * MS)
        assert "the attitude is not known" in r.driver.failsafe(now_ns + 300 * MS)
        assert r.armed
        await r.driver.write(now_ns + 1600 * MS)
        assert r.widths_us == STOP
        assert not r.armed


async def test_motors_stop_when_loop_hangs_or_driver_ends(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await r.arm()
        r.spin_until_stopped()  # nothing else runs on this loop meanwhile
        assert r.armed
        await r.arm()
        await r.driver.close()
        await r.until_stopped()


async def fly(r: Rig) -> None:
    """Lifts the vehicle off, as its driver detects it."""
    await r.arm()
    r.drives.write(Drive(0.0, 0.0, 1.0))
    async with asyncio.timeout(20.0):
        while r.driver.state is None or r.driver.state.landed:
            await r.step()
    assert min(r.widths_us) > IDLE[0]


async def test_driver_opened_in_flight_continues_pulses(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await fly(r)
        held = r.widths_us
        await r.driver.close()
        again = driver(r.folder)
        await again.open(r.module)
        try:
            assert r.widths_us == held, "until the first step"
            assert again.state == VehicleState(armed=True, landed=False)
            r.imu.write(STILL)
            await again.write(r.module.now_ns())
            assert min(r.widths_us) > IDLE[0]
            states = {one.name: one.state for one in again.conditions(r.module.now_ns())}
            assert states.keys() == {"flight/loop", "flight/tilt", "flight/contact", "flight/scheduling"}
        finally:
            await again.execute(ChassisAction.KILL)
            await again.close()


async def test_abandoned_flight_ends_with_motors_stopped(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await fly(r)
        held = r.widths_us
        await r.driver.close()
        assert r.widths_us == held
        await r.until_stopped()


async def test_vehicle_not_falling_after_gap_is_killed(
    tmp_path: Path,
) -> None:
    async with rig(tmp_path) as r:
        await fly(r)
        later_ns = r.module.now_ns() + 1500 * MS
        r.imu.write(STILL, later_ns)
        await r.driver.write(later_ns)
        assert not r.armed
        await r.until_stopped()
        (loop,) = (one for one in r.driver.conditions(later_ns) if one.name == "flight/loop")
        assert (loop.state, loop.level) == ("lost", "error")
        assert "the vehicle does not fall: 9.8 m/s² on it" in loop.detail


async def test_reopened_vehicle_is_disarmed_and_chip_awaited(tmp_path: Path) -> None:
    async with rig(tmp_path) as r:
        await r.arm()
        await r.driver.close()
        await r.driver.open(r.module)
        assert not r.armed
        lost = driver(tmp_path / "none")
        with pytest.raises(DeviceGone, match="no such device"):
            await lost.open(r.module)
        await lost.close()


@pytest.mark.parametrize(
    ("name", "settings", "expected"),
    [
        ("", PwmFlightDriver(), "no airframe; expected `airframe` in node.toml"),
        ("quad_1k5", PwmFlightDriver(motors=MOTORS[:3]), r"pwm_flight\.motors: 3 given; expected 4"),
        ("hexa_14k", PwmFlightDriver(motors=MOTORS), r"pwm_flight\.motors: 4 given; expected 6"),
        ("helicopter", PwmFlightDriver(motors=MOTORS[:1]), r"pwm_flight\.servos: 0 given; expected 4"),
        ("fixed_wing", PwmFlightDriver(), "expected an airframe that can hover"),
    ],
)
def test_outputs_that_do_not_fit_airframe_are_refused(
    name: str, settings: PwmFlightDriver, expected: str
) -> None:
    site = Site(PlatformKind.UAV, "", load_airframe(SHARE, name) if name else None)
    with pytest.raises(ConfigError, match=expected):
        make(Config(pwm_flight=settings), site)


def test_servo_widths_are_centred_and_motor_widths_positive() -> None:
    left = ServoPulse(channel=0, center_us=1520.0, range_us=-400.0)
    assert [left.width_us(value) for value in (-2.0, 0.0, 0.5)] == [1920.0, 1520.0, 1320.0]
    motor = MotorPulse(channel=0, stop_us=1100.0, full_us=1900.0)
    assert [motor.width_us(value) for value in (-1.0, 0.0, 0.5, 3.0)] == [1100.0, 1100.0, 1500.0, 1900.0]
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"channel": 0, "stop_us": -1.0}, MotorPulse)


@pytest.mark.parametrize(
    ("policy", "state", "level"),
    [
        (os.SCHED_OTHER, "shared", "warn"),
        (os.SCHED_BATCH, "shared", "warn"),
        (os.SCHED_FIFO, "ok", "ok"),
        (os.SCHED_RR | 0x40000000, "ok", "ok"),
    ],
)
def test_motor_loop_without_real_time_warns(policy: int, state: str, level: str) -> None:
    found = scheduling(policy)
    assert (found.name, found.state, found.level) == ("flight/scheduling", state, level)
