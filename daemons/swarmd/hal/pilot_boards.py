"""Boards of the safety pilot: position of the switch, sticks in manual mode, and state of the radio link."""

from swarmd.hal.config import PilotSettings
from swarmd.hal.core.safety_pilot import SafetyPilot
from swarmware.devices.crsf import RcChannels
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import RemoteLink, SafetySwitch
from swarmware.types.vehicle import Setpoint, VehicleMode


class PilotBoards:
    """Publishes the evaluated channels of a receiver; the sticks at most at `rate_hz`."""

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

        self._remote: BoardWriter[RemoteLink] = module.writer(
            "vehicle/remote", RemoteLink, description="Whether the safety pilot's transmitter is received"
        )
        self._linked: bool | None = None
        """Last published state of the link, or None before the first publication."""
        self._set_linked(False, module.now_ns())

    def on_link(self, quality_ratio: float) -> None:
        """Takes the quality of the radio link."""
        self._pilot.on_link(quality_ratio)
        if quality_ratio <= 0:
            self._set_linked(False, self._module.now_ns())

    def on_channels(self, channels: RcChannels, now_ns: int) -> bool:
        """Publishes the changes of a frame; returns False while the transmitter is lost."""
        found = self._pilot.on_channels(channels)
        if found is None:
            return False
        self._set_linked(True, now_ns)
        if found.switch is not None and found.switch is not self._position:
            self._position = found.switch
            self._switch.write(SafetySwitch(found.switch), now_ns)
        if found.sticks is not None and now_ns - self._sticks_ns >= 0.9 * self._period_ns:
            # 0.9 leaves room for the jitter of frames at just this rate
            self._sticks_ns = now_ns
            self._sticks.write(found.sticks, now_ns)
        return True

    def _set_linked(self, linked: bool, now_ns: int) -> None:
        """Publishes the state of the link if it changed."""
        if linked is not self._linked:
            self._linked = linked
            self._remote.write(RemoteLink(linked), now_ns)

    def close(self) -> None:
        """Closes the boards of switch, sticks and link."""
        for writer in (self._switch, self._sticks, self._remote):
            self._module.close_writer(writer)
