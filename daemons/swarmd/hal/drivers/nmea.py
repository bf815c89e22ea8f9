"""Driver of satellite receivers on a serial line, NMEA 0183."""

from swarmd.hal.config import Config, NmeaDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialSensor
from swarmware.devices.nmea import NmeaDecoder
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import GnssFix


class NmeaReceiver(SerialSensor[GnssFix]):
    """Publishes each fix as it arrives."""

    def __init__(self, config: NmeaDriver) -> None:
        super().__init__("nmea", config.device, config.baud, config.rate_hz, NmeaDecoder)
        self._config = config
        self._writer: BoardWriter[GnssFix] | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and the board of the fixes."""
        await super().open(module)
        self._writer = module.writer(self._config.path, GnssFix, rate_hz=self._config.rate_hz)

    def publish(self, value: GnssFix, now_ns: int) -> bool:
        """Writes the board of the fixes."""
        if self._writer is None:
            return False
        self._writer.write(value, now_ns)
        return True

    async def close(self) -> None:
        """Closes the line and the board."""
        await super().close()
        if self.module is not None and self._writer is not None:
            self.module.close_writer(self._writer)
            self._writer = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [NmeaReceiver(config.nmea)]
