"""An SPI device of the kernel: registers, with the direction in the highest bit of their number."""

import ctypes
import fcntl
import struct
from typing import Final

from swarmd.hal.buses.bus import DeviceFile, transfer_error
from swarmd.hal.buses.registers import RegisterBus

_SET_MODE: Final = 0x40016B01
_SET_BITS: Final = 0x40016B03
_SET_SPEED: Final = 0x40046B04
_MESSAGE: Final = 0x40206B00
"""SPI_IOC_WR_MODE, _WR_BITS_PER_WORD, _WR_MAX_SPEED_HZ, SPI_IOC_MESSAGE(1). Source: Linux,
include/uapi/linux/spi/spidev.h."""
_TRANSFER: Final = struct.Struct("=QQIIHBBBBBx")
"""struct spi_ioc_transfer: buffers to send and to receive, length, speed, and what is left at zero."""
_READ: Final = 0x80


class SpiBus(RegisterBus):
    """One device at a chip select such as `/dev/spidev0.0`, with eight bits a word.

    `mode`: clock polarity and phase, 0 to 3.
    """

    def __init__(self, path: str, speed_hz: int, mode: int = 0) -> None:
        self.path = path
        self._file = DeviceFile(path)
        try:
            for request, form, value in (
                (_SET_MODE, "=B", mode),
                (_SET_BITS, "=B", 8),
                (_SET_SPEED, "=I", speed_hz),
            ):
                fcntl.ioctl(self._file.fd, request, struct.pack(form, value))
        except OSError as error:
            self.close()
            raise transfer_error(path, error) from error

    def read(self, register: int, count: int) -> bytes:
        """Sends the number of the register, and receives its contents."""
        return self._transfer(bytes([register | _READ]) + bytes(count))[1:]

    def write(self, register: int, data: bytes) -> None:
        """Sends the number of the register and its contents."""
        self._transfer(bytes([register & ~_READ]) + data)

    def _transfer(self, data: bytes) -> bytes:
        sent = ctypes.create_string_buffer(data, len(data))
        received = ctypes.create_string_buffer(len(data))
        order = bytearray(
            _TRANSFER.pack(ctypes.addressof(sent), ctypes.addressof(received), len(data), 0, 0, 8, 0, 0, 0, 0)
        )
        try:
            fcntl.ioctl(self._file.fd, _MESSAGE, order)
        except OSError as error:
            raise transfer_error(self.path, error) from error
        return received.raw

    def close(self) -> None:
        """Closes the device file of the bus."""
        self._file.close()
