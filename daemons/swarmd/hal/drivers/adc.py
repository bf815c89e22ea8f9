"""Driver of analogue inputs, with converters in the kernel's industrial I/O on any bus."""

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.buses.iio import IioDevice
from swarmd.hal.config import AdcDriver, Config
from swarmd.hal.driver import Device, Site
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.scalar import Float


class AnalogueInputs(BlockingSensor[list[float]]):
    """Publishes each channel as a board; reads in a thread, because a converter on I2C or SPI blocks."""

    name = "adc"

    def __init__(self, config: AdcDriver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._converter = IioDevice(config.device)
        self._writers: list[BoardWriter[Float]] = []

    async def open(self, module: Module) -> None:
        """Opens a board for each channel. Raises: DeviceError as `measure`."""
        await super().open(module)
        rate_hz = self._config.rate_hz
        for channel in self._config.channels:
            writer = module.writer(channel.path, Float, unit=channel.unit, rate_hz=rate_hz, link="request")
            self._writers.append(self.managed(module, writer))

    def connect(self) -> None:
        """Reads all channels once, so that a missing one is an error of the opening."""
        self.measure()

    def measure(self) -> list[float]:
        """Values of all channels, in their units. Raises: DeviceGone; DeviceError without a number."""
        return [self._converter.voltage_v(one.channel) * one.per_volt for one in self._config.channels]

    def publish(self, value: list[float], now_ns: int) -> bool:
        """Writes the boards of all channels."""
        for writer, measured in zip(self._writers, value, strict=False):
            writer.write(Float(round(measured, 4)), now_ns)
        return bool(self._writers)

    async def close(self) -> None:
        """Closes the boards and ends the thread."""
        await super().close()
        self._writers.clear()


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the converter."""
    return [AnalogueInputs(config.adc)]
