"""Boards of the safety pilot: position of the switch, and the sticks while it is at manual."""

from swarmd.hal.config import PilotSettings
from swarmd.hal.core.safety_pilot import SafetyPilot
from swarmware.devices.crsf import RcChannels
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import SafetySwitch
from swarmware.types.vehicle import Setpoint, VehicleMode


class PilotBoards:
    """Writes what the channels of a receiver mean, the sticks at most at its rate."""

    def __init__(self, module: Module, settings: PilotSettings) -> None:
        self._module = module
        self._period_ns = 1e9 / settings.rate_hz
        self._pilot = SafetyPilot(settings)
        self._position: VehicleMode | None = None
        self._sticks_ns = 0
        self._switch: BoardWriter[SafetySwitch] = module.writer(
            "vehicle/switch", SafetySwitch, description="Position of the safety pilot's switch"
        )
        self._sticks: BoardWriter[Setpoint] = module.writer(
            "vehicle/sticks", Setpoint, description="Set-point of the safety pilot's sticks"
        )

    def on_link(self, quality_ratio: float) -> None:
        """Takes the quality of the radio link."""
        self._pilot.on_link(quality_ratio)

    def on_channels(self, channels: RcChannels, now_ns: int) -> bool:
        """Writes what a frame changes; False while the transmitter is lost."""
        found = self._pilot.on_channels(channels)
        if found is None:
            return False
        if found.switch is not None and found.switch is not self._position:
            self._position = found.switch
            self._switch.write(SafetySwitch(found.switch), now_ns)
        if found.sticks is not None and now_ns - self._sticks_ns >= 0.9 * self._period_ns:
            self._sticks_ns = now_ns
            self._sticks.write(found.sticks, now_ns)
        return True

    def close(self) -> None:
        """Closes the boards of switch and sticks."""
        for writer in (self._switch, self._sticks):
            self._module.close_writer(writer)
