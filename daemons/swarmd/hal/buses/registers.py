"""Buses to devices with numbered registers, I2C and SPI of the kernel, behind one interface."""

import ctypes
import fcntl
import struct
from abc import abstractmethod
from typing import Final

from swarmd.hal.buses.bus import Bus, DeviceFile, transfer_error
from swarmd.hal.config import RegisterBusName

_I2C_RDWR: Final = 0x0707
_I2C_READ: Final = 0x0001
"""I2C_RDWR, I2C_M_RD. Source: Linux, include/uapi/linux/i2c-dev.h and i2c.h."""

_SPI_SET_MODE: Final = 0x40016B01
_SPI_SET_BITS: Final = 0x40016B03
_SPI_SET_SPEED: Final = 0x40046B04
_SPI_MESSAGE: Final = 0x40206B00
"""SPI_IOC_WR_MODE, _WR_BITS_PER_WORD, _WR_MAX_SPEED_HZ, SPI_IOC_MESSAGE(1). Source: Linux,
include/uapi/linux/spi/spidev.h."""
_SPI_TRANSFER: Final = struct.Struct("=QQIIHBBBBBx")
"""struct spi_ioc_transfer: send buffer, receive buffer, length, speed, and fields that stay zero."""
_SPI_READ: Final = 0x80


class RegisterBus(Bus):
    """A bus to a device with numbered registers of one byte: I2C, SPI."""

    @abstractmethod
    def read(self, register: int, count: int) -> bytes:
        """Reads the contents of successive registers."""

    @abstractmethod
    def write(self, register: int, data: bytes) -> None:
        """Writes the contents of successive registers."""


class _I2cMessage(ctypes.Structure):
    _fields_ = [
        ("address", ctypes.c_uint16),
        ("flags", ctypes.c_uint16),
        ("length", ctypes.c_uint16),
        ("buffer", ctypes.c_void_p),
    ]


class _I2cTransfer(ctypes.Structure):
    _fields_ = [("messages", ctypes.c_void_p), ("count", ctypes.c_uint32)]


class I2cBus(RegisterBus):
    """One device with a 7-bit address, on a bus such as `/dev/i2c-1`."""

    def __init__(self, path: str, address: int) -> None:
        self._file = DeviceFile(path)
        self._address = address
        self.path = f"{path} address {address:#04x}"

    def read(self, register: int, count: int) -> bytes:
        """Writes the number of the register and reads, without releasing the bus in between."""
        number = ctypes.create_string_buffer(bytes([register]), 1)
        data = ctypes.create_string_buffer(count)
        # one transfer with a repeated start, which other masters of the bus cannot interrupt
        self._transfer((0, number, 1), (_I2C_READ, data, count))
        return data.raw

    def write(self, register: int, data: bytes) -> None:
        """Writes the number of the register and its contents in one message."""
        content = bytes([register]) + data
        self._transfer((0, ctypes.create_string_buffer(content, len(content)), len(content)))

    def _transfer(self, *parts: tuple[int, "ctypes.Array[ctypes.c_char]", int]) -> None:
        messages = (_I2cMessage * len(parts))(
            *(
                _I2cMessage(self._address, flags, length, ctypes.addressof(buffer))
                for flags, buffer, length in parts
            )
        )
        transfer = _I2cTransfer(ctypes.addressof(messages), len(parts))
        try:
            fcntl.ioctl(self._file.fd, _I2C_RDWR, transfer)
        except OSError as error:
            raise transfer_error(self.path, error) from error

    def close(self) -> None:
        """Closes the device file of the bus."""
        self._file.close()


class SpiBus(RegisterBus):
    """One device at a chip select such as `/dev/spidev0.0`, with 8-bit words.

    `mode`: clock polarity and phase, 0 to 3.
    """

    def __init__(self, path: str, speed_hz: int, mode: int = 0) -> None:
        self.path = path
        self._file = DeviceFile(path)
        try:
            for request, form, value in (
                (_SPI_SET_MODE, "=B", mode),
                (_SPI_SET_BITS, "=B", 8),
                (_SPI_SET_SPEED, "=I", speed_hz),
            ):
                fcntl.ioctl(self._file.fd, request, struct.pack(form, value))
        except OSError as error:
            self.close()
            raise transfer_error(path, error) from error

    def read(self, register: int, count: int) -> bytes:
        """Sends the number of the register, and receives its contents."""
        # the first byte arrives while the register's number is sent, and has no content
        return self._transfer(bytes([register | _SPI_READ]) + bytes(count))[1:]

    def write(self, register: int, data: bytes) -> None:
        """Sends the number of the register and its contents."""
        # the highest bit of the number selects reading
        self._transfer(bytes([register & ~_SPI_READ]) + data)

    def _transfer(self, data: bytes) -> bytes:
        sent = ctypes.create_string_buffer(data, len(data))
        # SPI receives while it sends, so both buffers have the same length
        received = ctypes.create_string_buffer(len(data))
        order = bytearray(
            _SPI_TRANSFER.pack(
                ctypes.addressof(sent), ctypes.addressof(received), len(data), 0, 0, 8, 0, 0, 0, 0
            )
        )
        try:
            fcntl.ioctl(self._file.fd, _SPI_MESSAGE, order)
        except OSError as error:
            raise transfer_error(self.path, error) from error
        return received.raw

    def close(self) -> None:
        """Closes the device file of the bus."""
        self._file.close()


def open_registers(bus: RegisterBusName, device: str, address: int, speed_hz: int) -> RegisterBus:
    """Opens a connection to a device on I2C or SPI. Raises: DeviceGone, DeviceError."""
    return I2cBus(device, address) if bus == "i2c" else SpiBus(device, speed_hz)
