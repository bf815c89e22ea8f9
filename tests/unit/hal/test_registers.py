"""I2C and SPI device files: requests to the kernel, and the messages of failures."""

import errno
import os
from pathlib import Path

import pytest
from tests.unit.hal.simulated_kernel import SPI_SETTINGS, Chip, simulated_kernel

from swarmd.hal.buses.bus import opening_error, transfer_error
from swarmd.hal.buses.registers import I2cBus, SpiBus, open_registers
from swarmd.hal.driver import DeviceError, DeviceGone


@pytest.mark.parametrize("bus", ["i2c", "spi"])
def test_registers_are_written_and_read_back(tmp_path: Path, bus: str) -> None:
    with simulated_kernel(tmp_path) as kernel:
        chip = Chip(0x68)
        path = kernel.plug(bus, chip)
        registers = open_registers(bus, path, 0x68, 500_000)  # type: ignore[arg-type]
        registers.write(0x1A, b"\x03\x18")
        assert chip.written == [(0x1A, b"\x03\x18")]
        assert registers.read(0x19, 4) == b"\x00\x03\x18\x00"
        assert chip.transfers == 1, "number and contents in one transfer"
        registers.close()
        registers.close()


def test_spi_device_opens_with_mode_and_clock(tmp_path: Path) -> None:
    with simulated_kernel(tmp_path) as kernel:
        SpiBus(kernel.plug("spidev0.0", Chip()), 500_000, mode=3).close()
        assert list(kernel.settings.values()) == [3, 8, 500_000]
        assert kernel.settings.keys() == SPI_SETTINGS.keys()


def test_unacknowledging_device_is_named_with_address(tmp_path: Path) -> None:
    with simulated_kernel(tmp_path) as kernel:
        bus = I2cBus(kernel.plug("i2c-1", Chip(0x76)), 0x77)
        with pytest.raises(DeviceError, match=r"i2c-1 address 0x77: the device does not answer") as caught:
            bus.read(0xD0, 1)
        assert not isinstance(caught.value, DeviceGone)
        bus.close()


def test_a_bus_that_was_unplugged_is_gone(tmp_path: Path) -> None:
    with simulated_kernel(tmp_path) as kernel:
        path = kernel.plug("i2c-1", Chip(0x76))
        bus = I2cBus(path, 0x76)
        Path(path).unlink()
        with pytest.raises(DeviceGone, match="unplugged"):
            bus.write(0xF4, b"\x57")
        bus.close()


@pytest.mark.parametrize("bus", ["i2c", "spi"])
def test_file_that_is_absent_or_another_is_named(tmp_path: Path, bus: str) -> None:
    with pytest.raises(DeviceGone, match=r"nothing: no such device"):
        open_registers(bus, str(tmp_path / "nothing"), 0x68, 1000)  # type: ignore[arg-type]
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(DeviceError, match="not a bus of this kind"):
        open_registers(bus, str(file), 0x68, 1000).read(0, 1)  # type: ignore[arg-type]


def test_no_file_stays_open_after_a_failure(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    before = len([*Path("/proc/self/fd").iterdir()])
    for _ in range(5):
        with pytest.raises(DeviceError):
            SpiBus(str(file), 1000)
    assert len([*Path("/proc/self/fd").iterdir()]) == before


@pytest.mark.parametrize(
    ("code", "cls", "text"),
    [
        (errno.EACCES, DeviceError, "permission denied; expected read and write access"),
        (errno.ENODEV, DeviceGone, "no such device"),
        (errno.EBUSY, DeviceError, "busy"),
    ],
)
def test_why_a_bus_was_not_opened_is_stated(code: int, cls: type[DeviceError], text: str) -> None:
    found = opening_error("/dev/i2c-1", OSError(code, os.strerror(code)))
    assert type(found) is cls
    assert text in str(found)


def test_error_of_transfer_keeps_words_of_kernel() -> None:
    found = transfer_error("/dev/spidev0.0", OSError(errno.EIO, os.strerror(errno.EIO)))
    assert str(found) == "/dev/spidev0.0: Input/output error"
