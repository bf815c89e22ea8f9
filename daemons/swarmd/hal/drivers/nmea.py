"""Driver of satellite receivers on a serial line, NMEA 0183 and UBX."""

from typing import Final

from swarmd.hal.config import Config, NmeaDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialBoard
from swarmware.devices.gnss_receiver import ReceiverDecoder
from swarmware.module.module import Module
from swarmware.types.vehicle import GnssFix

FIX_BYTES: Final = 2 * 82
"""Maximum size of the sentences GGA and GST (or RMC) of one fix. Source: NMEA 0183, 5.3."""


class NmeaReceiver(SerialBoard[GnssFix]):
    """Publishes each fix when it arrives."""

    def __init__(self, config: NmeaDriver) -> None:
        self._messages = ReceiverDecoder()
        self._fix_ns = 0
        super().__init__("nmea", config, GnssFix, self._new_decoder, FIX_BYTES)

    def _new_decoder(self) -> ReceiverDecoder:
        self._messages = ReceiverDecoder()
        return self._messages

    async def open(self, module: Module) -> None:
        """Opens the line and the board. Raises: DeviceGone, DeviceError."""
        await super().open(module)
        self._fix_ns = module.now_ns()

    def publish(self, value: GnssFix, now_ns: int) -> bool:
        """Writes the board of the fixes."""
        self._fix_ns = now_ns
        return super().publish(value, now_ns)

    def stalled(self, now_ns: int) -> str:
        """Reason why valid sentences contain no fix, or "" if they do."""
        if now_ns - self._fix_ns <= self.silent_s * 1e9 or self._messages.valid == 0:
            return ""
        return f"{self._device}: sentences are valid, {self._messages.reason}"


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [NmeaReceiver(config.nmea)]
