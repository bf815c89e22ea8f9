"""Driver of the barometer BMP280 on I2C or SPI."""

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.buses.registers import RegisterBus, open_registers
from swarmd.hal.config import Bmp280Driver, Config
from swarmd.hal.core import bmp280
from swarmd.hal.driver import Device, DeviceError, Site
from swarmware.errors import WireError
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import Barometer


class Bmp280(BlockingSensor[Barometer]):
    """Publishes pressure and temperature, compensated by the coefficients of the chip."""

    name = "bmp280"

    def __init__(self, config: Bmp280Driver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._bus: RegisterBus | None = None
        self._calibration: bmp280.Calibration | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[Barometer] | None = None

    async def open(self, module: Module) -> None:
        """Opens the bus and the board."""
        await super().open(module)
        config, self._module = self._config, module
        self._writer = module.writer(config.path, Barometer, rate_hz=config.rate_hz, link="request")

    def connect(self) -> None:
        """Finds the chip and starts it. Raises: DeviceError when it is another one."""
        config = self._config
        self._bus = bus = open_registers(config.bus, config.device, config.address, config.speed_hz)
        chip = bus.read(bmp280.ID, 1)[0]
        if chip not in bmp280.CHIPS:
            raise DeviceError(f"{bus.path}: chip {chip:#04x}, expected a BMP280 (0x58) or BME280 (0x60)")
        try:
            self._calibration = bmp280.calibration(bus.read(bmp280.CALIBRATION, bmp280.CALIBRATION_BYTES))
        except WireError as error:
            raise DeviceError(f"{bus.path}: {error}") from error
        bus.write(bmp280.CONFIG, bytes([bmp280.FILTERED]))
        bus.write(bmp280.CONTROL, bytes([bmp280.NORMAL]))

    def measure(self) -> Barometer:
        """Reads both values. Raises: DeviceError when they cannot be measurements."""
        bus, calibration = self._bus, self._calibration
        if bus is None or calibration is None:
            raise DeviceError(f"{self._config.device}: not open")
        if (found := bus.read(bmp280.CONTROL, 1)[0]) != bmp280.NORMAL:
            raise DeviceError(
                f"{bus.path}: register {bmp280.CONTROL:#04x} has {found:#04x}, expected {bmp280.NORMAL:#04x}:"
                " it lost its supply, or its connection"
            )
        try:
            return bmp280.measurement(bus.read(bmp280.DATA, bmp280.DATA_BYTES), calibration)
        except WireError as error:
            raise DeviceError(f"{bus.path}: {error}") from error

    def publish(self, value: Barometer, now_ns: int) -> bool:
        """Writes the board of the barometer."""
        if self._writer is None:
            return False
        self._writer.write(value, now_ns)
        return True

    def disconnect(self) -> None:
        """Closes the bus in its thread."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    async def close(self) -> None:
        """Closes the board, and the bus."""
        await super().close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
            self._writer = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the barometer."""
    return [Bmp280(config.bmp280)]
