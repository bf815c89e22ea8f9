"""Driver of satellite receivers on a serial line, NMEA 0183."""

from typing import Final

from swarmd.hal.buses.serial_line import SerialLine
from swarmd.hal.config import Config, NmeaDriver
from swarmd.hal.core.nmea import NmeaDecoder
from swarmd.hal.driver import Device, DeviceError, Sensor, Site
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import GnssFix

_SILENT_NS: Final = 5_000_000_000
"""Time without a valid sentence after which the receiver counts as failed."""


class NmeaReceiver(Sensor):
    """Publishes each fix as it arrives; `read` watches the line."""

    name = "nmea"

    def __init__(self, config: NmeaDriver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._decoder = NmeaDecoder()
        self._line: SerialLine | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[GnssFix] | None = None
        self._fixes = self._counted = self._sentences = 0
        self._received_ns = 0

    @property
    def refused(self) -> dict[str, int]:
        """What was not understood since the line was opened, by the reason."""
        return self._decoder.refused

    async def open(self, module: Module) -> None:
        """Opens the line and the writer of the fixes."""
        config = self._config
        self._module, self._decoder = module, NmeaDecoder()
        self._sentences, self._received_ns = 0, module.now_ns()
        self._line = SerialLine(config.device, config.baud, self._take)
        self._writer = module.writer(config.path, GnssFix, rate_hz=config.rate_hz)

    def _take(self, data: bytes) -> None:
        writer, module = self._writer, self._module
        if writer is None or module is None:
            return
        for fix in self._decoder.feed(data):
            writer.write(fix, module.now_ns())
            self._fixes += 1

    async def read(self, now_ns: int) -> bool:
        """Whether there was a fix since the last call.

        Raises: DeviceGone when the line is lost; DeviceError when no valid sentence arrives.
        """
        if self._line is not None:
            self._line.check()
        if self._decoder.sentences != self._sentences:
            self._sentences, self._received_ns = self._decoder.sentences, now_ns
        elif now_ns - self._received_ns > _SILENT_NS:
            counts = sorted(self.refused.items(), key=lambda item: -item[1])[:2]
            refused = ", ".join(f"{count} × {what}" for what, count in counts) or "none"
            raise DeviceError(f"{self._config.device}: no valid sentence for 5 s; refused: {refused}")
        fresh = self._fixes != self._counted
        self._counted = self._fixes
        return fresh

    async def close(self) -> None:
        """Closes the line and the writer."""
        if self._line is not None:
            self._line.close()
            self._line = None
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
            self._writer = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [NmeaReceiver(config.nmea)]
