"""Outputs of pulses by the files of the kernel, in a folder of the test: widths, safe widths, a lost chip."""

import asyncio
import shutil
from pathlib import Path

import pytest
from tests.unit.hal.pwm_chip import chip, number
from tests.unit.hal.rig import running
from tests.unit.hal.status import state_of, status

from swarmd.hal.buses.pwm import PwmChannel
from swarmd.hal.config import Config, ServoDriver, ServoOutput
from swarmd.hal.driver import DeviceError, DeviceGone
from swarmd.hal.drivers.servo import Servos
from swarmd.hal.outputs import ActuatorOutput
from swarmware.module.module import Module
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReports
from swarmware.types.scalar import Float
from swarmware.types.vehicle import VehicleState

FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)
RUDDER = ServoOutput(channel=0, path="act/rudder", range_us=400.0)
MOTOR = ServoOutput(channel=1, path="act/motor", safe_us=1000.0, needs_arming=True)


async def until(folder: Path, name: str, wanted: int, other: Module) -> None:
    """Waits until a file of the chip has a value; the board of the drivers gives the pace."""
    board = other.reader("hal/drivers", DriverTable)
    async with asyncio.timeout(20.0):
        while number(folder, name) != wanted:
            await board.changed()


def test_an_output_follows_fresh_set_points_only() -> None:
    output = ActuatorOutput("act/motor", 0.5, needs_arming=True)
    assert output.value(0, armed=True) is None
    assert output.failsafe(10**10, armed=True) == "", "no set-point was ever there"
    output.on_value(Float(0.25), 1_000)
    output.on_value(Float(float("nan")), 2_000)
    assert output.value(500_000_000, armed=True) == 0.25
    assert output.value(500_000_000, armed=False) is None
    assert output.value(500_001_001, armed=True) is None
    assert output.failsafe(500_001_001, armed=True) == "no set-point in act/motor for more than 0.5 s"
    assert output.failsafe(500_001_001, armed=False) == ""
    output.on_value(Float(-7.0), 600_000_000)
    assert output.value(600_000_000, armed=True) == -1.0


async def test_servos_follow_boards_then_take_safe_width(tmp_path: Path) -> None:
    folder = chip(tmp_path)
    config = ServoDriver(device=str(folder), outputs=(RUDDER, MOTOR), rate_hz=50.0)
    async with running(tmp_path, [Servos(config)], FAST) as other:
        await until(folder, "pwm0/enable", 1, other)
        await until(folder, "pwm1/duty_cycle", 1_000_000, other)
        assert number(folder, "pwm0/period") == 20_000_000
        rudder, motor = other.writer("act/rudder", Float), other.writer("act/motor", Float)
        vehicle = other.writer("vehicle/state", VehicleState)
        board = other.reader("hal/drivers", DriverTable)

        async def drive(armed: bool, wanted: int) -> None:
            vehicle.write(VehicleState(armed, landed=True))
            async with asyncio.timeout(20.0):
                while number(folder, "pwm1/duty_cycle") != wanted:
                    rudder.write(Float(-0.5))
                    motor.write(Float(0.2))
                    await board.changed()

        await drive(True, 1_600_000)
        assert number(folder, "pwm0/duty_cycle") == 1_300_000
        await drive(False, 1_000_000)
        assert number(folder, "pwm0/duty_cycle") == 1_300_000, "a rudder needs no arming"
        assert (await status(board, "servo", state="failsafe")).note.startswith("no set-point in act/rudder")
        checks = other.reader("health/checks/hal", CheckReports)
        assert await state_of(checks, "hal/failsafe/servo", "failsafe")
        await until(folder, "pwm0/duty_cycle", 1_500_000, other)


async def test_outputs_end_safe_and_lost_chip_awaited(tmp_path: Path) -> None:
    folder = chip(tmp_path)
    config = ServoDriver(device=str(folder), outputs=(RUDDER,), rate_hz=50.0)
    servos = Servos(config)
    async with running(tmp_path, [servos], FAST) as other:
        rudder, board = other.writer("act/rudder", Float), other.reader("hal/drivers", DriverTable)
        async with asyncio.timeout(20.0):
            while number(folder, "pwm0/duty_cycle") != 1_900_000:
                rudder.write(Float(1.0))
                await board.changed()
        await servos.close()
        async with asyncio.timeout(20.0):
            while number(folder, "pwm0/duty_cycle") != 1_500_000:
                await board.changed()
    shutil.rmtree(folder)
    async with running(tmp_path / "b", [Servos(config)], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        assert "pwm0: no such device" in (await status(board, "servo", state="waiting")).note
        chip(tmp_path)
        await status(board, "servo", state="running")


def test_channel_without_rights_or_period_is_refused(tmp_path: Path) -> None:
    folder = chip(tmp_path, 1)
    channel = PwmChannel(str(folder), 0, 0.0025)
    with pytest.raises(DeviceError, match="pulse of 2600 µs, expected at most one period"):
        channel.set_pulse(2600.0)
    channel.close()
    with pytest.raises(DeviceGone, match="pwm7: no such device"):
        PwmChannel(str(folder), 7, 0.02)
    assert (folder / "export").read_text() == "7\n", "the kernel was asked for the channel"
