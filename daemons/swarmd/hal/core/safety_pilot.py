"""Evaluation of the safety pilot's transmitter: position of the switch, and set-point of the sticks."""

from typing import TYPE_CHECKING, Final

import msgspec

from swarmware.devices.crsf import RcChannels
from swarmware.types.vehicle import Setpoint, VehicleMode

if TYPE_CHECKING:
    from swarmd.hal.config import PilotSettings

CONFIRMATIONS: Final = 3
"""Consecutive frames that move the switch, because an 8-bit CRC passes one of 256 damaged frames."""
_MANUAL_ABOVE: Final = 0.3
_AUTO_BELOW: Final = -0.3
"""Switch thresholds, with hysteresis."""


class PilotInput(msgspec.Struct, frozen=True, gc=False):
    """Decoded meaning of one frame of the transmitter."""

    switch: VehicleMode | None
    """Position of the switch, or None while it is not known."""
    sticks: Setpoint | None
    """Set-point of the sticks, or None while the switch is at auto."""


class SafetyPilot:
    """Evaluates the channels of the receiver, and ignores them while the radio link is lost."""

    def __init__(self, config: "PilotSettings") -> None:
        self._config = config
        self._linked = True
        self._switch: VehicleMode | None = None
        self._next: VehicleMode | None = None
        self._count = 0

    def on_link(self, quality_ratio: float) -> None:
        """Takes the quality of the radio link; at 0 the receiver repeats outdated channels."""
        self._linked = quality_ratio > 0
        if not self._linked:
            self._count = 0

    def on_channels(self, channels: RcChannels) -> PilotInput | None:
        """Takes a frame; returns its meaning, or None while the transmitter is lost."""
        if not self._linked:
            return None
        positions, config = channels.positions, self._config
        self._confirm(positions[config.switch_channel - 1])
        # in auto the sticks may be anywhere, and must not reach the vehicle
        if self._switch is not VehicleMode.MANUAL:
            return PilotInput(self._switch, None)

        def stick(channel: int) -> float:
            position = positions[channel - 1]
            beyond = abs(position) - config.dead_band_ratio
            if beyond <= 0:
                return 0.0
            # scaled, so that the output has no step at the edge of the dead band
            return beyond / (1 - config.dead_band_ratio) * (1 if position > 0 else -1)

        return PilotInput(
            self._switch,
            Setpoint(
                stick(config.pitch_channel) * config.speed_m_s,
                -stick(config.roll_channel) * config.speed_m_s,
                stick(config.throttle_channel) * config.climb_m_s,
                -stick(config.yaw_channel) * config.turn_rad_s,
            ),
        )

    def _confirm(self, position: float) -> None:
        """Moves the switch when enough consecutive frames agree."""
        found = self._switch
        if position > _MANUAL_ABOVE:
            found = VehicleMode.MANUAL
        elif position < _AUTO_BELOW:
            found = VehicleMode.AUTO
        # a differing frame starts the count again
        self._count = self._count + 1 if found is self._next else 1
        self._next = found
        if self._count >= CONFIRMATIONS:
            self._switch = found
