"""Driver of a radio-control receiver with a sum signal (PPM) at a GPIO line."""

from typing import Final

from swarmd.hal.buses.gpio import GpioEdges
from swarmd.hal.config import Config, PpmDriver
from swarmd.hal.driver import Device, DeviceError, Sensor, Site
from swarmd.hal.pilot_boards import PilotBoards
from swarmware.devices.ppm import PpmDecoder
from swarmware.module.module import Module

SILENT_NS: Final = 1_000_000_000
"""Time without a valid frame after which the receiver counts as failed; it sends 45 frames a second."""


class PpmReceiver(Sensor):
    """Publishes the switch and the sticks of the safety pilot, as the driver `crsf` does.

    The signal has no state of the radio link, so the receiver must stop it when the transmitter is lost.
    """

    name = "ppm"

    def __init__(self, config: PpmDriver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._decoder = PpmDecoder()
        self._edges: GpioEdges | None = None
        self._boards: PilotBoards | None = None
        self._module: Module | None = None
        self._valid = 0
        self._received_ns = 0

    async def open(self, module: Module) -> None:
        """Opens the line and both boards. Raises: DeviceGone, DeviceError."""
        self._module, self._decoder, self._valid = module, PpmDecoder(), 0
        self._received_ns = module.now_ns()
        self._edges = GpioEdges(self._config.device, self._config.line, self._take, self._decoder.on_lost)
        self._boards = PilotBoards(module, self._config)

    def _take(self, stamp_ns: int) -> None:
        channels = self._decoder.edge(stamp_ns)
        if channels is not None and self._boards is not None and self._module is not None:
            self._boards.on_channels(channels, self._module.now_ns())

    async def read(self, now_ns: int) -> bool:
        """Returns True if a frame arrived since the last call.

        Raises: DeviceGone when the line is lost; DeviceError when no valid frame arrives.
        """
        if self._edges is not None:
            # before the frames: a lost line would otherwise count as a silent receiver
            self._edges.check()
        # by frames and not by edges: noise on an open line has edges as well
        if self._decoder.valid != self._valid:
            self._valid, self._received_ns = self._decoder.valid, now_ns
            return True
        if now_ns - self._received_ns > SILENT_NS:
            refused = (
                ", ".join(f"{count} × {what}" for what, count in self._decoder.refused.items()) or "none"
            )
            raise DeviceError(
                f"{self._config.device} line {self._config.line}: no valid frame for 1 s; refused: {refused}"
            )
        return False

    async def close(self) -> None:
        """Closes the line and both boards."""
        if self._edges is not None:
            self._edges.close()
            self._edges = None
        if self._boards is not None:
            self._boards.close()
            self._boards = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [PpmReceiver(config.ppm)]
