"""Driver of VectorNav inertial units on a serial line, with binary output."""

from swarmd.hal.config import Config, VectorNavDriver
from swarmd.hal.driver import Device, Site
from swarmd.hal.imu_source import ImuSource
from swarmd.hal.serial_sensor import SerialBoard
from swarmware.devices.vectornav import FRAME_BYTES, VectorNavDecoder
from swarmware.types.vehicle import Imu


class VectorNavImu(ImuSource, SerialBoard[Imu]):
    """Publishes each measurement when it arrives, with the heading of the unit."""

    silent_s = 1.0

    def __init__(self, config: VectorNavDriver) -> None:
        super().__init__("vectornav", config, Imu, VectorNavDecoder, FRAME_BYTES)

    def publish(self, value: Imu, now_ns: int) -> bool:
        """Writes the board of the unit."""
        return super().publish(self.corrected(value), now_ns)


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the unit."""
    return [VectorNavImu(config.vectornav)]
