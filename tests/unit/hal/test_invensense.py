"""Inertial units: scales and axes, and the driver on a simulated chip that wakes, sleeps and vanishes."""

import math
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.simulated_kernel import Chip, simulated_kernel
from tests.unit.hal.status import status

from swarmd.hal.config import Axis, Config, InvensenseDriver
from swarmd.hal.core.invensense import DATA, is_right_handed, measurement
from swarmd.hal.drivers.invensense import InvensenseImu
from swarmware.errors import ConfigError, WireError
from swarmware.types.driver import DriverTable
from swarmware.types.vehicle import Imu

FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)
UPRIGHT: tuple[Axis, Axis, Axis] = ("x", "y", "z")
RAW = struct.pack(">7h", 2048, 0, -1024, 0, 164, -328, 0)
"""1 g along x, -0.5 g along z, 10 °/s about x, -20 °/s about y."""


class InertialChip(Chip):
    """A chip that measures while it is awake, and returns zeros while it sleeps."""

    def read(self, register: int, count: int) -> bytes:
        self.registers[DATA : DATA + 14] = RAW if self.registers[0x6B] == 1 else bytes(14)
        return super().read(register, count)


def unit(chip_id: int = 0x12) -> InertialChip:
    chip = InertialChip(0x68)
    chip.registers[0x75] = chip_id
    chip.registers[0x6B] = 0x40
    return chip


def test_values_are_si_in_body_frame() -> None:
    found = measurement(RAW, UPRIGHT)
    assert (found.ax_m_s2, found.ay_m_s2) == (9.80665, 0.0)
    assert found.az_m_s2 == pytest.approx(-9.80665 / 2)
    assert found.wx_rad_s == pytest.approx(math.radians(10.0))
    turned = measurement(RAW, ("-y", "x", "z"))
    assert turned.ay_m_s2 == 9.80665
    assert turned.wx_rad_s == pytest.approx(math.radians(20.0))


@pytest.mark.parametrize("silent", [b"\x00" * 14, b"\xff" * 14, b"\x01" * 13])
def test_a_silent_chip_gives_no_measurement(silent: bytes) -> None:
    with pytest.raises(WireError, match=r"asleep, or not connected|13 bytes"):
        measurement(silent, UPRIGHT)


@given(st.binary(min_size=14, max_size=14))
def test_any_bytes_are_in_range_or_refused(data: bytes) -> None:
    try:
        found = measurement(data, UPRIGHT)
    except WireError:
        return
    assert abs(found.ax_m_s2) <= 16 * 9.80665
    assert abs(found.wz_rad_s) <= math.radians(2000)


def test_mirrored_or_collinear_axes_are_refused() -> None:
    assert is_right_handed(UPRIGHT)
    assert is_right_handed(("x", "-y", "-z"))
    assert not is_right_handed(("y", "x", "z"))
    with pytest.raises(ConfigError, match=r"invensense\.axes: x x z, expected three different axes"):
        InvensenseImu(InvensenseDriver(axes=("x", "x", "z")))


@pytest.mark.parametrize(("bus", "chip_id"), [("spi", 0x12), ("i2c", 0x68)])
async def test_sleeping_unit_is_woken_and_read_again(tmp_path: Path, bus: str, chip_id: int) -> None:
    with simulated_kernel(tmp_path) as kernel:
        chip = unit(chip_id)
        device = kernel.plug("bus", chip)
        config = InvensenseDriver(bus=bus, device=device, rate_hz=200.0)  # type: ignore[arg-type]
        async with running(tmp_path, [InvensenseImu(config)], FAST) as other:
            board = other.reader("hal/drivers", DriverTable)
            values = other.reader("sensor/imu", Imu)
            assert (await values.changed(20.0)).ax_m_s2 == 9.80665
            assert dict(chip.written)[0x1B] == b"\x18"
            chip.registers[0x6B] = 0x40
            assert "asleep" in (await status(board, "invensense", state="failed")).note
            await status(board, "invensense", state="running")
            await values.changed(20.0)


async def test_foreign_or_unwritable_chip_is_named(tmp_path: Path) -> None:
    class Locked(InertialChip):
        def write(self, register: int, data: bytes) -> None:
            """A chip that ignores all writes."""

    locked = Locked(0x68)
    locked.registers[0x75], locked.registers[0x6B] = 0x12, 0x40
    with simulated_kernel(tmp_path) as kernel:
        strange = InvensenseImu(InvensenseDriver(device=kernel.plug("strange", unit(0x58))))
        strange.name = "strange"
        deaf = InvensenseImu(InvensenseDriver(device=kernel.plug("locked", locked)))
        async with running(tmp_path, [strange, deaf], FAST) as other:
            board = other.reader("hal/drivers", DriverTable)
            note = (await status(board, "strange", state="failed")).note
            assert "chip 0x58, expected one of ICM-20602 (0x12)" in note
            note = (await status(board, "invensense", state="failed")).note
            assert "register 0x6b has 0x40, expected 0x01" in note
