"""The barometer: formulas of its data sheet, and its driver on a simulated chip behind both buses."""

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.simulated_kernel import Chip, UpperChip, simulated_kernel
from tests.unit.hal.status import state_of, status

from swarmd.hal.config import Bmp280Driver, Config
from swarmd.hal.core.bmp280 import DATA, Calibration, calibration, measurement
from swarmd.hal.drivers.bmp280 import Bmp280
from swarmware.errors import WireError
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReports
from swarmware.types.vehicle import Barometer

T = (27504, 26435, -1000)
P = (36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000)
"""Coefficients of the example of the data sheet, section 3.12."""
COEFFICIENTS = struct.pack("<HhhHhhhhhhhh", *T, *P)
RAW_PRESSURE, RAW_TEMPERATURE = 415148, 519888
MEASURED = Barometer(100653.26, 25.08)
FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)


def raw(pressure: int, temperature: int) -> bytes:
    return b"".join((value << 4).to_bytes(3, "big") for value in (pressure, temperature))


def started(chip: Chip) -> Chip:
    """A chip with the coefficients and values of the example, which runs when it is configured."""
    chip.registers[0xD0] = 0x58
    chip.registers[0x88 : 0x88 + 24] = COEFFICIENTS
    chip.registers[DATA : DATA + 6] = raw(RAW_PRESSURE, RAW_TEMPERATURE)
    return chip


def test_the_example_of_the_data_sheet_is_reproduced() -> None:
    found = measurement(raw(RAW_PRESSURE, RAW_TEMPERATURE), calibration(COEFFICIENTS))
    assert found.temperature_degc == 25.08
    assert found.pressure_pa == pytest.approx(100653.27, abs=0.02)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (raw(0x80000, 0x80000), "no measurement yet"),
        (raw(0, RAW_TEMPERATURE), "outside of the chip's range"),
        (raw(RAW_PRESSURE, 0), "outside of the chip's range"),
        (b"\x00" * 5, "5 bytes, expected 6"),
    ],
)
def test_what_no_air_has_is_refused(data: bytes, text: str) -> None:
    with pytest.raises(WireError, match=text):
        measurement(data, Calibration(T, P))


@given(data=st.binary(max_size=7), coefficients=st.binary(max_size=25))
def test_any_bytes_are_a_measurement_or_refused(data: bytes, coefficients: bytes) -> None:
    try:
        found = measurement(data, calibration(coefficients))
    except WireError:
        return
    assert 30_000 <= found.pressure_pa <= 110_000


@pytest.mark.parametrize("bus", ["i2c", "spi"])
async def test_barometer_is_started_read_lost_and_found_again(tmp_path: Path, bus: str) -> None:
    with simulated_kernel(tmp_path) as kernel:
        chip = started(UpperChip(0x76) if bus == "spi" else Chip(0x76))
        config = Bmp280Driver(bus=bus, device=kernel.plug("bus", chip), rate_hz=20.0)  # type: ignore[arg-type]
        async with running(tmp_path, [Bmp280(config)], FAST) as other:
            board = other.reader("hal/drivers", DriverTable)
            found = await other.reader("sensor/barometer", Barometer).changed(20.0)
            assert found.pressure_pa == pytest.approx(MEASURED.pressure_pa, abs=0.02)
            assert chip.written == [(0xF5, b"\x10"), (0xF4, b"\x57")]
            chip.silent = True
            failed = await status(board, "bmp280", state="failed")
            assert ("does not answer" if bus == "i2c" else "0xff") in failed.note
            checks = other.reader("health/checks/hal", CheckReports)
            assert await state_of(checks, "hal/driver/bmp280", "failed")
            chip.silent = False
            await status(board, "bmp280", state="running")
            assert await state_of(checks, "hal/driver/bmp280", "ok")


async def test_chip_that_lost_its_supply_is_started_again(tmp_path: Path) -> None:
    with simulated_kernel(tmp_path) as kernel:
        chip = started(Chip(0x76))
        config = Bmp280Driver(device=kernel.plug("bus", chip), rate_hz=20.0)
        async with running(tmp_path, [Bmp280(config)], FAST) as other:
            board = other.reader("hal/drivers", DriverTable)
            values = other.reader("sensor/barometer", Barometer)
            await values.changed(20.0)
            chip.registers[0xF4] = 0
            assert (
                "has 0x00, expected 0x57: the chip lost its supply"
                in (await status(board, "bmp280", state="failed")).note
            )
            await values.changed(20.0)
            assert chip.registers[0xF4] == 0x57


@pytest.mark.parametrize(("chip_id", "text"), [(0x12, "chip 0x12, expected a BMP280"), (0x58, "no calib")])
async def test_another_chip_is_named_and_ends_nothing(tmp_path: Path, chip_id: int, text: str) -> None:
    with simulated_kernel(tmp_path) as kernel:
        chip = Chip(0x76)
        chip.registers[0xD0] = chip_id
        config = Bmp280Driver(device=kernel.plug("bus", chip))
        async with running(tmp_path, [Bmp280(config)], FAST) as other:
            board = other.reader("hal/drivers", DriverTable)
            assert text in (await status(board, "bmp280", state="failed")).note
