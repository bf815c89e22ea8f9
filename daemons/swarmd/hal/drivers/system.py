"""Driver of the computer, which publishes load, memory, disk and temperature."""

import os
from typing import Final

from swarmd.hal.config import Config
from swarmd.hal.driver import Device, Sensor, Site
from swarmd.hal.drivers.computer import disk_free_bytes, memory_used_ratio, temperature_degc
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.runtime.processor import ProcessorUse
from swarmware.types.system import SystemLoad

TEMPERATURE_EVERY: Final = 10
"""Number of reads between two measurements of the temperature, each of which searches the folders of all
sensors."""


class System(Sensor):
    """Publishes the load of the computer on which the node runs."""

    name = "system"

    def __init__(self, rate_hz: float) -> None:
        self.period_s = 1 / rate_hz
        self._rate_hz = rate_hz
        self._writer: BoardWriter[SystemLoad] | None = None
        self._processors: ProcessorUse | None = None
        self._disk = "/"
        self._temperature_degc: float | None = None
        self._reads = 0

    async def open(self, module: Module) -> None:
        """Opens the writer of `system/load`."""
        writer = module.writer("system/load", SystemLoad, rate_hz=self._rate_hz)
        self._writer = self.managed(module, writer)
        self._processors = ProcessorUse()

    async def read(self, now_ns: int) -> bool:
        """Publishes the counters of the kernel."""
        if self._writer is None or self._processors is None:
            return False
        if self._reads % TEMPERATURE_EVERY == 0:
            self._temperature_degc = temperature_degc()
        self._reads += 1
        self._writer.write(
            SystemLoad(
                self._processors.percent(),
                round(memory_used_ratio(), 4),
                disk_free_bytes(self._disk),
                round(os.getloadavg()[0], 2),
                self._temperature_degc,
            )
        )
        return True


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the computer."""
    return [System(config.system.rate_hz)]
