"""Driver of inertial units of VectorNav on a serial line, binary output."""

from swarmd.hal.config import Config, VectorNavDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialSensor
from swarmware.devices.vectornav import VectorNavDecoder
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import Imu


class VectorNavImu(SerialSensor[Imu]):
    """Publishes each measurement as it arrives, with the heading of the unit."""

    silent_s = 1.0

    def __init__(self, config: VectorNavDriver) -> None:
        super().__init__("vectornav", config.device, config.baud, config.rate_hz, VectorNavDecoder)
        self._config = config
        self._writer: BoardWriter[Imu] | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and the board of the unit."""
        await super().open(module)
        self._writer = module.writer(self._config.path, Imu, rate_hz=self._config.rate_hz)

    def publish(self, value: Imu, now_ns: int) -> bool:
        """Writes the board of the unit."""
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
    """Creates the driver of the unit."""
    return [VectorNavImu(config.vectornav)]
