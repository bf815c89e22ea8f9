"""Driver of satellite receivers on a serial line, NMEA 0183."""

from typing import Final

from swarmd.hal.config import Config, NmeaDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialBoard
from swarmware.devices.nmea import NmeaDecoder
from swarmware.types.vehicle import GnssFix

FIX_BYTES: Final = 2 * 82
"""The sentences GGA and GST (or RMC) of one fix, at their longest. Source: NMEA 0183, 5.3."""


class NmeaReceiver(SerialBoard[GnssFix]):
    """Publishes each fix as it arrives."""

    def __init__(self, config: NmeaDriver) -> None:
        super().__init__("nmea", config, GnssFix, NmeaDecoder, FIX_BYTES)


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [NmeaReceiver(config.nmea)]
