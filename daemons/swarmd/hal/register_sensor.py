"""Sensors with numbered registers on I2C or SPI, whose measurements are read in a thread."""

from abc import abstractmethod
from typing import Generic, Protocol, TypeVar

import msgspec

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.buses.registers import RegisterBus, open_registers
from swarmd.hal.config import RegisterBusName
from swarmd.hal.core.line_load import register_use
from swarmd.hal.driver import DeviceError
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter

T = TypeVar("T", bound=msgspec.Struct)


class RegisterSettings(Protocol):
    """Settings that all drivers of register sensors have."""

    @property
    def bus(self) -> RegisterBusName: ...
    @property
    def device(self) -> str: ...
    @property
    def address(self) -> int: ...
    @property
    def speed_hz(self) -> int: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def path(self) -> str: ...


class RegisterSensor(BlockingSensor[T], Generic[T]):
    """Base of the drivers of register sensors, which differ in the start and the reading of the chip.

    `reads`: number of registers of each read of a measurement.
    """

    def __init__(self, name: str, settings: RegisterSettings, cls: type[T], reads: tuple[int, ...]) -> None:
        self.name = name
        self.period_s = 1 / settings.rate_hz
        self.line_uses = (
            register_use(settings.bus, settings.device, settings.speed_hz, reads, settings.rate_hz),
        )
        self._settings = settings
        self._cls = cls
        self._bus: RegisterBus | None = None
        self._writer: BoardWriter[T] | None = None

    async def open(self, module: Module) -> None:
        """Opens the bus and the board."""
        await super().open(module)
        settings = self._settings
        writer = module.writer(settings.path, self._cls, rate_hz=settings.rate_hz, link="request")
        self._writer = self.managed(module, writer)

    def connect(self) -> None:
        """Opens the bus and starts the chip. Raises: DeviceError for another chip."""
        settings = self._settings
        self._bus = open_registers(settings.bus, settings.device, settings.address, settings.speed_hz)
        # after each opening: a chip that was unplugged has lost its settings
        self.begin(self._bus)

    @abstractmethod
    def begin(self, bus: RegisterBus) -> None:
        """Identifies the chip and starts it. Raises: DeviceError for another chip, or if it is not
        writable."""

    def measure(self) -> T:
        """Reads one measurement. Raises: DeviceError when the chip is closed or gives no measurement."""
        if self._bus is None:
            raise DeviceError(f"{self._settings.device}: not open")
        return self.measured(self._bus)

    @abstractmethod
    def measured(self, bus: RegisterBus) -> T:
        """Reads one measurement from the registers. Raises: DeviceError."""

    def publish(self, value: T, now_ns: int) -> bool:
        """Writes the board of the sensor."""
        if self._writer is None:
            return False
        self._writer.write(value, now_ns)
        return True

    def disconnect(self) -> None:
        """Closes the bus in its thread."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None
