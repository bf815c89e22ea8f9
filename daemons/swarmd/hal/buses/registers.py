"""Buses to devices with numbered registers, I2C and SPI, behind one interface."""

from abc import abstractmethod

from swarmd.hal.buses.bus import Bus
from swarmd.hal.config import RegisterBusName


class RegisterBus(Bus):
    """A bus to a device with numbered registers of one byte: I2C, SPI."""

    @abstractmethod
    def read(self, register: int, count: int) -> bytes:
        """The contents of successive registers."""

    @abstractmethod
    def write(self, register: int, data: bytes) -> None:
        """Writes the contents of successive registers."""


def open_registers(bus: RegisterBusName, device: str, address: int, speed_hz: int) -> RegisterBus:
    """A connection to the device. Raises: DeviceGone, DeviceError."""
    if bus == "i2c":
        from swarmd.hal.buses.i2c import I2cBus

        return I2cBus(device, address)
    from swarmd.hal.buses.spi import SpiBus

    return SpiBus(device, speed_hz)
