"""Driver of analogue inputs: the kernel's industrial I/O, whatever bus the converter is on."""

from pathlib import Path

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.config import AdcDriver, Config
from swarmd.hal.driver import Device, DeviceError, Site
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.scalar import Float


class AnalogueInputs(BlockingSensor[list[float]]):
    """Publishes each channel as a board; a converter behind I2C or SPI blocks its reader."""

    name = "adc"

    def __init__(self, config: AdcDriver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._module: Module | None = None
        self._writers: list[BoardWriter[Float]] = []

    async def open(self, module: Module) -> None:
        """Opens a board for each channel. Raises: OSError, DeviceError as `measure`."""
        self.measure()
        self._module = module
        rate_hz = self._config.rate_hz
        for channel in self._config.channels:
            self._writers.append(
                module.writer(channel.path, Float, unit=channel.unit, rate_hz=rate_hz, link="request")
            )

    def measure(self) -> list[float]:
        """The values of all channels, in their units. Raises: OSError; DeviceError without a number."""
        folder = Path(self._config.device)
        return [
            (_number(folder / f"in_voltage{one.channel}_raw") + _offset(folder, one.channel))
            * _scale(folder, one.channel)
            / 1000
            * one.per_volt
            for one in self._config.channels
        ]

    def publish(self, value: list[float], now_ns: int) -> bool:
        """Writes the boards of all channels."""
        for writer, measured in zip(self._writers, value, strict=False):
            writer.write(Float(round(measured, 4)), now_ns)
        return bool(self._writers)

    async def close(self) -> None:
        """Closes the boards and ends the thread."""
        await super().close()
        for writer in self._writers:
            if self._module is not None:
                self._module.close_writer(writer)
        self._writers.clear()


def _number(file: Path) -> float:
    text = file.read_text("ascii", "replace").strip()
    try:
        return float(text)
    except ValueError:
        raise DeviceError(f"{file}: {text[:20]!r}, expected a number") from None


def _scale(folder: Path, channel: int) -> float:
    """Millivolts of one step. Source: Linux, ABI/testing/sysfs-bus-iio."""
    own = folder / f"in_voltage{channel}_scale"
    return _number(own if own.exists() else folder / "in_voltage_scale")


def _offset(folder: Path, channel: int) -> float:
    for file in (folder / f"in_voltage{channel}_offset", folder / "in_voltage_offset"):
        if file.exists():
            return _number(file)
    return 0.0


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the converter."""
    return [AnalogueInputs(config.adc)]
