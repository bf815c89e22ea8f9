"""Driver of a radio-control receiver on a serial line (CRSF): switch and sticks of the safety pilot."""

from typing import Final

from swarmd.hal.config import Config, CrsfDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.pilot_boards import PilotBoards
from swarmd.hal.serial_sensor import SerialSensor
from swarmware.devices.crsf import BAUD, CrsfDecoder, RcChannels, RcLink
from swarmware.module.module import Module

FRAME_BYTES: Final = 26
"""Size of a frame with channels: address, size, type, 22 bytes, CRC."""
FRAMES_HZ: Final = 500.0
"""Highest packet rate of ExpressLRS at 2.4 GHz."""


class CrsfReceiver(SerialSensor[RcChannels | RcLink]):
    """Publishes the position of the switch when it changes, and the sticks while it is at manual.

    When the transmitter is lost, the switch keeps its position and no sticks are published, so the vehicle
    holds or stays with the navigator.
    """

    silent_s = 1.0

    def __init__(self, config: CrsfDriver) -> None:
        super().__init__("crsf", config.device, BAUD, config.rate_hz, CrsfDecoder, FRAME_BYTES * FRAMES_HZ)
        self._config = config
        self._boards: PilotBoards | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and both boards."""
        await super().open(module)
        self._boards = PilotBoards(module, self._config)

    def publish(self, value: RcChannels | RcLink, now_ns: int) -> bool:
        """Publishes the changes of a frame; returns False if it has no channels."""
        if self._boards is None:
            return False
        if isinstance(value, RcLink):
            self._boards.on_link(value.quality_ratio)
            return False
        return self._boards.on_channels(value, now_ns)

    async def close(self) -> None:
        """Closes the line and both boards."""
        await super().close()
        if self._boards is not None:
            self._boards.close()
            self._boards = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [CrsfReceiver(config.crsf)]
