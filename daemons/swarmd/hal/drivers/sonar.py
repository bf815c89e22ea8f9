"""Driver of MaxBotix sonars on a serial line."""

from functools import partial
from typing import Final

from swarmd.hal.config import Config, SonarDriver
from swarmd.hal.core.median import MedianFilter
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialSensor
from swarmware.devices.maxbotix import SonarDecoder
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.scalar import Float

READING_BYTES: Final = 6
"""Size of a reading `R1234` with its end, for models in millimetres; other models send one digit less."""


class SerialSonar(SerialSensor[float]):
    """Publishes the height above the ground with outlier rejection, unless the ground is out of range."""

    silent_s = 2.0

    def __init__(self, config: SonarDriver) -> None:
        decoder = partial(SonarDecoder, config.unit)
        bytes_s = READING_BYTES * config.rate_hz
        super().__init__("sonar", config.device, config.baud, config.rate_hz, decoder, bytes_s)
        self._config = config
        self._filter = MedianFilter(config.window)
        self._writer: BoardWriter[Float] | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and the board of the height."""
        await super().open(module)
        self._filter.reset()
        # without a rate, because a sonar out of range publishes nothing, which is not a fault
        writer = module.writer(self._config.path, Float, unit="m", link="request")
        self._writer = self.managed(module, writer)

    def publish(self, value: float, now_ns: int) -> bool:
        """Writes the filtered height, if the ground is within the range."""
        height_m = self._filter.add(value)
        if self._writer is None or not self._config.min_m <= height_m < self._config.max_m:
            return False
        self._writer.write(Float(round(height_m, 3)), now_ns)
        return True


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the sonar."""
    return [SerialSonar(config.sonar)]
