"""Driver of a radio-control receiver on a serial line (CRSF): switch and sticks of the safety pilot."""

from typing import Final

from swarmd.hal.config import Config, CrsfDriver
from swarmd.hal.core.safety_pilot import SafetyPilot
from swarmd.hal.driver import Device, Site
from swarmd.hal.serial_sensor import SerialSensor
from swarmware.devices.crsf import BAUD, CrsfDecoder, RcChannels, RcLink
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import SafetySwitch
from swarmware.types.vehicle import Setpoint, VehicleMode

FRAME_BYTES: Final = 26
"""Frame of the channels: address, size, type, 22 bytes, CRC."""
FRAMES_HZ: Final = 500.0
"""The fastest packet rate of ExpressLRS at 2.4 GHz."""


class CrsfReceiver(SerialSensor[RcChannels | RcLink]):
    """Publishes the position of the switch when it changes, and the sticks while it is at manual.

    When the transmitter is lost, the switch keeps its position and the sticks end: the vehicle holds, or
    stays with the navigator.
    """

    silent_s = 1.0

    def __init__(self, config: CrsfDriver) -> None:
        super().__init__("crsf", config.device, BAUD, config.rate_hz, CrsfDecoder, FRAME_BYTES * FRAMES_HZ)
        self._config = config
        self._pilot = SafetyPilot(config)
        self._position: VehicleMode | None = None
        self._sticks_ns = 0
        self._switch: BoardWriter[SafetySwitch] | None = None
        self._sticks: BoardWriter[Setpoint] | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and both boards."""
        await super().open(module)
        self._pilot, self._position = SafetyPilot(self._config), None
        self._switch = module.writer(
            "vehicle/switch", SafetySwitch, description="Position of the safety pilot's switch"
        )
        self._sticks = module.writer(
            "vehicle/sticks", Setpoint, description="Set-point of the safety pilot's sticks"
        )

    def publish(self, value: RcChannels | RcLink, now_ns: int) -> bool:
        """Writes what the frame changes."""
        if isinstance(value, RcLink):
            self._pilot.on_link(value.quality_ratio)
            return False
        found = self._pilot.on_channels(value)
        if found is None or self._switch is None or self._sticks is None:
            return False
        if found.switch is not None and found.switch is not self._position:
            self._position = found.switch
            self._switch.write(SafetySwitch(found.switch), now_ns)
        if found.sticks is not None and now_ns - self._sticks_ns >= 0.9e9 * self.period_s:
            self._sticks_ns = now_ns
            self._sticks.write(found.sticks, now_ns)
        return True

    async def close(self) -> None:
        """Closes the line and both boards."""
        await super().close()
        for writer in (self._switch, self._sticks):
            if self.module is not None and writer is not None:
                self.module.close_writer(writer)
        self._switch = self._sticks = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the receiver."""
    return [CrsfReceiver(config.crsf)]
