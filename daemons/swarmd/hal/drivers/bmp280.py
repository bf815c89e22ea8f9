"""Driver of the barometer BMP280 on I2C or SPI."""

from swarmd.hal.buses.registers import RegisterBus
from swarmd.hal.config import Bmp280Driver, Config
from swarmd.hal.core import bmp280
from swarmd.hal.driver import Device, DeviceError, Site
from swarmd.hal.register_sensor import RegisterSensor
from swarmware.errors import WireError
from swarmware.types.vehicle import Barometer


class Bmp280(RegisterSensor[Barometer]):
    """Publishes pressure and temperature, compensated with the coefficients of the chip."""

    def __init__(self, config: Bmp280Driver) -> None:
        super().__init__("bmp280", config, Barometer, (1, bmp280.DATA_BYTES))
        self._calibration: bmp280.Calibration | None = None

    def begin(self, bus: RegisterBus) -> None:
        """Identifies the chip and starts it. Raises: DeviceError for another chip."""
        chip = bus.read(bmp280.ID, 1)[0]
        if chip not in bmp280.CHIPS:
            raise DeviceError(f"{bus.path}: chip {chip:#04x}, expected a BMP280 (0x58) or BME280 (0x60)")
        try:
            self._calibration = bmp280.calibration(bus.read(bmp280.CALIBRATION, bmp280.CALIBRATION_BYTES))
        except WireError as error:
            raise DeviceError(f"{bus.path}: {error}") from error
        bus.write(bmp280.CONFIG, bytes([bmp280.FILTERED]))
        bus.write(bmp280.CONTROL, bytes([bmp280.NORMAL]))

    def measured(self, bus: RegisterBus) -> Barometer:
        """Reads pressure and temperature. Raises: DeviceError when the values are invalid."""
        calibration = self._calibration
        if calibration is None:
            raise DeviceError(f"{bus.path}: not started")
        if (found := bus.read(bmp280.CONTROL, 1)[0]) != bmp280.NORMAL:
            raise DeviceError(
                f"{bus.path}: register {bmp280.CONTROL:#04x} has {found:#04x}, expected {bmp280.NORMAL:#04x}:"
                " the chip lost its supply or its connection"
            )
        try:
            return bmp280.measurement(bus.read(bmp280.DATA, bmp280.DATA_BYTES), calibration)
        except WireError as error:
            raise DeviceError(f"{bus.path}: {error}") from error


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the barometer."""
    return [Bmp280(config.bmp280)]
