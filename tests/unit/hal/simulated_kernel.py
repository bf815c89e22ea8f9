"""The kernel's side of I2C and SPI device files: its requests, carried out by a chip with registers."""

import ctypes
import errno
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

I2C_RDWR = 0x0707
SPI_MESSAGE = 0x40206B00
SPI_SETTINGS = {0x40016B01: "B", 0x40016B03: "B", 0x40046B04: "I"}


class Chip:
    """Registers that are read and written in succession, at one address of a bus."""

    def __init__(self, address: int = 0) -> None:
        self.address = address
        self.registers = bytearray(256)
        self.silent = False
        self.written: list[tuple[int, bytes]] = []
        self.transfers = 0

    def read(self, register: int, count: int) -> bytes:
        self.transfers += 1
        return bytes(self.registers[register : register + count])

    def write(self, register: int, data: bytes) -> None:
        self.written.append((register, data))
        self.registers[register : register + len(data)] = data


class Kernel:
    """Carries out the requests to the device files of one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.chips: dict[str, Chip] = {}
        self.settings: dict[int, int] = {}

    def plug(self, name: str, chip: Chip) -> str:
        path = self.folder / name
        path.touch()
        self.chips[str(path)] = chip
        return str(path)

    def ioctl(self, fd: int, request: int, argument: object) -> int:
        path = str(Path(f"/proc/self/fd/{fd}").readlink())
        chip = self.chips.get(path.removesuffix(" (deleted)"))
        if chip is None:
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        if path.endswith("(deleted)"):
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if request in SPI_SETTINGS:
            assert isinstance(argument, bytes)
            (self.settings[request],) = struct.unpack("=" + SPI_SETTINGS[request], argument)
        elif request == I2C_RDWR:
            self._i2c(bytes(memoryview(argument).cast("B")), chip)  # type: ignore[arg-type]
        elif request == SPI_MESSAGE:
            assert isinstance(argument, bytearray)
            self._spi(bytes(argument), chip)
        else:
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        return 0

    def _i2c(self, transfer: bytes, chip: Chip) -> None:
        messages, count = struct.unpack("@PI", transfer[: struct.calcsize("@PI")])
        size = struct.calcsize("@HHHP")
        register = -1
        for k in range(count):
            address, flags, length, buffer = struct.unpack(
                "@HHHP", ctypes.string_at(messages + k * size, size)
            )
            if address != chip.address or chip.silent:
                raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
            if flags & 1:
                ctypes.memmove(buffer, chip.read(register, length), length)
                continue
            data = ctypes.string_at(buffer, length)
            register = data[0]
            if len(data) > 1:
                chip.write(register, data[1:])

    def _spi(self, transfer: bytes, chip: Chip) -> None:
        sent, received, length = struct.unpack_from("=QQI", transfer)
        data = ctypes.string_at(sent, length)
        answer = b"\xff" * length
        if not chip.silent:
            if data[0] & 0x80:
                answer = b"\xff" + chip.read(data[0] & 0x7F | self._bank(chip), length - 1)
            else:
                chip.write(data[0] | self._bank(chip), data[1:])
        ctypes.memmove(received, answer, length)

    def _bank(self, chip: Chip) -> int:
        """The barometer has its registers at 0x80 to 0xFF: on SPI their highest bit is the direction."""
        return 0x80 if isinstance(chip, UpperChip) else 0


class UpperChip(Chip):
    """A chip whose registers begin at 0x80."""


@contextmanager
def simulated_kernel(folder: Path) -> Iterator[Kernel]:
    """Takes the place of the kernel below the device files of a folder."""
    kernel = Kernel(folder)
    with patch("swarmd.hal.buses.registers.fcntl.ioctl", kernel.ioctl):
        yield kernel
