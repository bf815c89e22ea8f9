"""The driver my_name: the daemon hal opens its device, and reads it periodically."""

from pathlib import Path
from typing import Annotated

import msgspec
from swarmd.hal.config import Config
from swarmd.hal.driver import DeviceError, Sensor, Site
from swarmware import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.scalar import Float


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of this driver: table [plugins.my_name] of services/hal.toml."""

    device: str = "/proc/uptime"
    """File of the device; its first word is a number."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 5.0
    """Reads per second."""


class MyName(Sensor):
    """Publishes the number that the device gives as the board `sensor/my_name`."""

    name = "my_name"

    def __init__(self, settings: Settings) -> None:
        self.period_s = 1 / settings.rate_hz
        self._settings = settings
        self._writer: BoardWriter[Float] | None = None

    async def open(self, module: Module) -> None:
        """Open the writer; an OSError or DeviceError here means that hal tries again later."""
        self.measure()
        writer = module.writer(
            "sensor/my_name",
            Float,
            rate_hz=self._settings.rate_hz,
            description="The number of the device",
        )
        # the base class closes it with the device, so that readers see that the device is lost
        self._writer = self.managed(module, writer)

    async def read(self, now_ns: int) -> bool:
        """Read the device once and publish its value."""
        if self._writer is None:
            return False
        self._writer.write(Float(self.measure()), stamp_ns=now_ns)
        return True

    def measure(self) -> float:
        """The number that the device gives now. Raises: DeviceError, OSError."""
        # replace it by the protocol of your device
        text = Path(self._settings.device).read_text("utf-8")
        try:
            return float(text.split()[0])
        except (IndexError, ValueError):
            what = f"{self._settings.device}: {text!r}; expected a number"
            raise DeviceError(what) from None


def make(config: Config, site: Site) -> list[Sensor]:
    """The drivers of this platform, one per device; pyproject.toml names this function."""
    return [MyName(config.plugin("my_name", Settings))]
