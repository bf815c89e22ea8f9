"""Inertial unit and sonar on serial lines: published as they arrive, silent ones are named."""

import asyncio
from pathlib import Path

import pytest
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.buses.serial_line import SerialLine
from swarmd.hal.config import Config, SonarDriver, VectorNavDriver
from swarmd.hal.drivers.sonar import SerialSonar
from swarmd.hal.drivers.vectornav import VectorNavImu
from swarmware.devices.maxbotix import SonarUnit, reading
from swarmware.devices.vectornav import frame
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.types.driver import DriverTable
from swarmware.types.scalar import Float
from swarmware.types.vehicle import Imu

FAST = Config(drivers=(), retry_s=0.05, report_hz=50.0, failures=1)
LEVEL = Imu(0.0, 0.0, 0.25, 0.0, 0.0, 9.75, 0.5)


async def test_unit_is_published_and_foreign_data_named(tmp_path: Path) -> None:
    line = PseudoTerminal(tmp_path / "imu", lambda data: None)
    driver = VectorNavImu(VectorNavDriver(device=str(tmp_path / "imu"), rate_hz=50.0))
    async with running(tmp_path, [driver], FAST) as other:
        board, values = other.reader("hal/drivers", DriverTable), other.reader("sensor/imu", Imu)
        await status(board, "vectornav", state="running")
        async with asyncio.timeout(20.0):
            while values.value is None:
                line.write(b"$VNYMR,+006.380*6A\r\n" + frame(LEVEL))
                await board.changed()
        assert values.value.wz_rad_s == 0.25
        assert values.value.yaw_rad == pytest.approx(0.5, abs=1e-6)
        failed = await status(board, "vectornav", state="failed")
        assert "nothing valid for 1 s; refused:" in failed.note
    line.close()


async def test_sonar_height_is_filtered_and_ends_in_range(
    tmp_path: Path,
) -> None:
    line = PseudoTerminal(tmp_path / "sonar", lambda data: None)
    config = SonarDriver(device=str(tmp_path / "sonar"), rate_hz=50.0, window=3, min_m=0.3)
    async with running(tmp_path, [SerialSonar(config)], FAST) as other:
        board, heights = other.reader("hal/drivers", DriverTable), other.reader("sensor/height", Float)
        await status(board, "sonar", state="running")
        line.write(b"".join(reading(m, SonarUnit.MM) for m in (2.0, 2.1, 4.9)))
        async with asyncio.timeout(20.0):
            while heights.value != Float(2.1):
                await heights.changed()
        before = heights.sequence
        line.write(b"".join(reading(m, SonarUnit.MM) for m in (9.9, 9.9, 9.9, 0.1, 0.1, 0.1)))
        await status(board, "sonar", reads=1)
        assert heights.sequence == before + 1, "4.9 m is the last one within the range"
        assert heights.value == Float(4.9)
    line.close()


async def test_a_line_may_have_any_rate(tmp_path: Path) -> None:
    line = PseudoTerminal(tmp_path / "rc", lambda data: None)
    received: list[bytes] = []
    other = SerialLine(str(tmp_path / "rc"), 420_000, received.append)
    line.write(b"\xc8")
    async with asyncio.timeout(20.0):
        while not received:  # noqa: ASYNC110 - the line is read by the event loop
            await asyncio.sleep(0)
    assert received == [b"\xc8"]
    other.close()
    line.close()
