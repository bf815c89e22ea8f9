"""Devices on serial lines, simulated on pseudo-terminals: a receiver, a chassis, unplugged and back."""

import asyncio
import os
import pty
import tty
from pathlib import Path

import pytest
from tests.unit.devices.receivers import CLASSIC, RMC
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.buses.serial_line import SerialLine
from swarmd.hal.config import ChassisConfig, Config, NmeaDriver, SerialChassisDriver
from swarmd.hal.driver import DeviceError
from swarmd.hal.drivers.nmea import NmeaReceiver
from swarmd.hal.drivers.serial_chassis import SerialChassis
from swarmware.errors import Denied
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.firmware import ChassisFirmware
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import ChassisReport, GainsRequest
from swarmware.types.control import Drive
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReport, CheckReports
from swarmware.types.vehicle import ArmRequest, BatteryState, GnssFix, KillRequest, Setpoint, VehicleState

DATA = Path(__file__).parents[2] / "data"
ZDA = b"$GPZDA,201530.00,04,07,2002,00,00*60\r\n"
RETRY = {"drivers": (), "retry_s": 0.05, "report_hz": 50.0, "failures": 2}


async def test_serial_chassis_is_armed_driven_and_killed(
    tmp_path: Path,
) -> None:
    firmware = ChassisFirmware(tmp_path / "tty")
    firmware.noise = b"\x07noise\0"
    config = Config(**RETRY, serial_chassis=SerialChassisDriver(device=str(firmware.link)))  # type: ignore[arg-type]
    firmware.plug()
    try:
        async with running(tmp_path, [SerialChassis(config)], config) as other:
            state = other.reader("vehicle/state", VehicleState)
            assert await state.changed(20.0) == VehicleState(armed=False, landed=True)
            board = other.reader("hal/drivers", DriverTable)
            battery = await other.reader("power/battery", BatteryState).changed(20.0)
            assert battery == BatteryState(24.5, 3.25, 0.75)
            firmware.ignored_orders = 2
            assert (
                await other.request("sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=20.0)
            ).armed
            drive = other.writer("act/drive", Drive)
            async with asyncio.timeout(20.0):
                while Setpoint(1.5, 0.0, 0.0, 0.25) not in firmware.setpoints:
                    drive.write(Drive(1.5, wz_rad_s=0.25))
                    await asyncio.sleep(0.01)
                while firmware.setpoints[-1] != Setpoint(0.0):  # no more set-points arrive
                    await board.changed()
            killed = await other.request(
                "sys/vehicle/kill", KillRequest("uav1"), VehicleState, timeout_s=20.0
            )
            assert not killed.armed
            assert not firmware.report.armed
    finally:
        firmware.unplug()


async def test_gains_are_sent_again_to_returning_chassis(
    tmp_path: Path,
) -> None:
    firmware = ChassisFirmware(tmp_path / "tty")
    firmware.gains["yaw_kp"] = 0.5
    chassis = ChassisConfig(gains={"rate_kp": 0.25})
    serial = SerialChassisDriver(device=str(firmware.link))
    config = Config(**RETRY, chassis=chassis, serial_chassis=serial)  # type: ignore[arg-type]
    firmware.plug()
    async with running(tmp_path, [SerialChassis(config)], config) as other:
        path, board = "sys/vehicle/gains", other.reader("hal/drivers", DriverTable)
        async with asyncio.timeout(20.0):
            while firmware.gains["rate_kp"] != 0.25:
                await board.changed()
        with pytest.raises(Denied, match="no gain sway_kp"):
            gains = {"yaw_kp": 2.0, "sway_kp": 1.0}
            await other.request(path, GainsRequest(gains), VehicleState, timeout_s=20.0)
        with pytest.raises(Denied, match="expected at least one"):
            await other.request(path, GainsRequest({}), VehicleState, timeout_s=20.0)
        await other.request(path, GainsRequest({"yaw_kp": 1.5}), VehicleState, timeout_s=20.0)
        assert firmware.gains == {"rate_kp": 0.25, "yaw_kp": 1.5}
        firmware.unplug()
        await status(board, "serial_chassis", state="waiting")
        firmware.gains = {"rate_kp": 0.1, "yaw_kp": 0.5}
        firmware.report = ChassisReport(armed=False, landed=True)
        firmware.plug()
        async with asyncio.timeout(20.0):
            while firmware.gains != {"rate_kp": 0.25, "yaw_kp": 1.5}:
                await board.changed()
    firmware.unplug()


async def test_unplugged_chassis_is_fault_until_reopened(tmp_path: Path) -> None:
    firmware = ChassisFirmware(tmp_path / "tty")
    config = Config(**RETRY, serial_chassis=SerialChassisDriver(device=str(firmware.link)))  # type: ignore[arg-type]
    async with running(tmp_path, [SerialChassis(config)], config) as other:
        board = other.reader("hal/drivers", DriverTable)
        assert "no such device" in (await status(board, "serial_chassis", state="waiting")).note
        firmware.plug()
        await status(board, "serial_chassis", state="running")
        firmware.unplug()
        assert "unplugged" in (await status(board, "serial_chassis", state="waiting")).note
        firmware.plug()
        await status(board, "serial_chassis", state="running")
        firmware.unplug()


async def test_receiver_publishes_fixes_despite_garbage(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    config = NmeaDriver(device=os.ttyname(slave), rate_hz=50.0)
    try:
        async with running(tmp_path, [NmeaReceiver(config)], Config(**RETRY)) as other:  # type: ignore[arg-type]
            board = other.reader("hal/drivers", DriverTable)
            fixes = other.reader("sensor/gnss", GnssFix)
            await status(board, "nmea", state="running")
            os.write(master, bytes(range(256)) + b"\n" + RMC + CLASSIC[:20])
            os.write(master, CLASSIC[20:])
            assert (await fixes.changed(20.0)).satellites == 8
            assert (await status(board, "nmea", reads=1)).errors == 0
    finally:
        os.close(slave)
        os.close(master)


async def test_receiver_without_position_is_fault_that_says_why(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    line = os.ttyname(slave)
    receiver = NmeaReceiver(NmeaDriver(device=line, rate_hz=50.0))
    receiver.silent_s = 0.3
    try:
        async with running(tmp_path, [receiver], Config(**RETRY)) as other:  # type: ignore[arg-type]
            board = other.reader("hal/drivers", DriverTable)
            checks = other.reader("health/checks/hal", CheckReports)
            await status(board, "nmea", state="running")
            sender = asyncio.create_task(repeated(master, ZDA))
            report = await reported(checks, "no data")
            assert report.freeze.startswith(f"{line}: sentences are valid, none with a position: enable GGA")
            found = await status(board, "nmea", note=report.freeze)
            assert found.state == "running"
            sender.cancel()
            sender = asyncio.create_task(repeated(master, (DATA / "null_island.nmea").read_bytes()))
            await status(board, "nmea", note=f"{line}: sentences are valid, GGA: a fix without satellites")
            sender.cancel()
            sender = asyncio.create_task(repeated(master, CLASSIC))
            await status(board, "nmea", note="")
            await reported(checks, "ok")
            sender.cancel()
    finally:
        os.close(slave)
        os.close(master)


async def repeated(line: int, sentences: bytes) -> None:
    """A receiver that repeats the same sentences."""
    while True:
        os.write(line, sentences)
        await asyncio.sleep(0.05)


async def reported(checks: BoardReader[CheckReports], state: str) -> CheckReport:
    """Waits until the check of the receiver has a state."""
    async with asyncio.timeout(20.0):
        while True:
            found = [one for one in (await checks.changed()).reports if one.check == "hal/driver/nmea"]
            if found and found[0].state == state:
                return found[0]


async def test_receiver_with_invalid_rate_names_arrivals(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    receiver = NmeaReceiver(NmeaDriver(device=os.ttyname(slave)))
    try:
        async with tmp_node(tmp_path) as node, Module("hal", node=node) as module:
            await receiver.open(module)
            os.write(master, b"\xf0\x0f\n" * 3)
            async with asyncio.timeout(20.0):
                while not receiver.refused:  # noqa: ASYNC110 - the line is read by the event loop
                    await asyncio.sleep(0)
            with pytest.raises(DeviceError, match=r"nothing valid for 5 s; refused: \d × no sentence"):
                await receiver.read(module.now_ns() + 5_100_000_000)
            await receiver.close()
    finally:
        os.close(slave)
        os.close(master)


async def test_used_or_invalid_line_is_refused(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    line = SerialLine(os.ttyname(slave), 9600, lambda data: None)
    try:
        with pytest.raises(DeviceError, match="another process has it open"):
            SerialLine(os.ttyname(slave), 9600, lambda data: None)
        with pytest.raises(DeviceError, match="50 baud, expected 300 to 4000000"):
            SerialLine(os.ttyname(slave), 50, lambda data: None)
        file = tmp_path / "file"
        file.write_bytes(b"")
        with pytest.raises(DeviceError, match="no serial line"):
            SerialLine(str(file), 9600, lambda data: None)
    finally:
        line.close()
        os.close(slave)
        os.close(master)


async def test_unread_line_drops_and_counts() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    line = SerialLine(os.ttyname(slave), 115200, lambda data: None)
    try:
        for _ in range(1000):
            line.write(bytes(254))
        assert line.dropped > 0
    finally:
        line.close()
        os.close(slave)
        os.close(master)
