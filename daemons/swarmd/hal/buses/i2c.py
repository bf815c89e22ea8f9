"""An I2C bus of the kernel: registers of one device, read by combined transfers."""

import ctypes
import fcntl
from typing import Final

from swarmd.hal.buses.bus import DeviceFile, transfer_error
from swarmd.hal.buses.registers import RegisterBus

_RDWR: Final = 0x0707
_READ: Final = 0x0001
"""I2C_RDWR, I2C_M_RD. Source: Linux, include/uapi/linux/i2c-dev.h and i2c.h."""


class _Message(ctypes.Structure):
    _fields_ = [
        ("address", ctypes.c_uint16),
        ("flags", ctypes.c_uint16),
        ("length", ctypes.c_uint16),
        ("buffer", ctypes.c_void_p),
    ]


class _Transfer(ctypes.Structure):
    _fields_ = [("messages", ctypes.c_void_p), ("count", ctypes.c_uint32)]


class I2cBus(RegisterBus):
    """One device, by its address of seven bits, on a bus such as `/dev/i2c-1`."""

    def __init__(self, path: str, address: int) -> None:
        self._file = DeviceFile(path)
        self._address = address
        self.path = f"{path} address {address:#04x}"

    def read(self, register: int, count: int) -> bytes:
        """Writes the number of the register and reads, without releasing the bus between both."""
        number = ctypes.create_string_buffer(bytes([register]), 1)
        data = ctypes.create_string_buffer(count)
        self._transfer((0, number, 1), (_READ, data, count))
        return data.raw

    def write(self, register: int, data: bytes) -> None:
        """Writes the number of the register and its contents in one message."""
        content = bytes([register]) + data
        self._transfer((0, ctypes.create_string_buffer(content, len(content)), len(content)))

    def _transfer(self, *parts: tuple[int, "ctypes.Array[ctypes.c_char]", int]) -> None:
        messages = (_Message * len(parts))(
            *(
                _Message(self._address, flags, length, ctypes.addressof(buffer))
                for flags, buffer, length in parts
            )
        )
        transfer = _Transfer(ctypes.addressof(messages), len(parts))
        try:
            fcntl.ioctl(self._file.fd, _RDWR, transfer)
        except OSError as error:
            raise transfer_error(self.path, error) from error

    def close(self) -> None:
        """Closes the device file of the bus."""
        self._file.close()
