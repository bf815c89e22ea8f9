"""Control of a vehicle: modes, the commands that reach its chassis, requests for the stick."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite
from swarmware.types.registry import register
from swarmware.types.vehicle import Setpoint, VehicleMode


class DriveMode(OpenEnum):
    """Mode: the source of set-points that drives the vehicle."""

    AUTO = "auto"
    """The navigator, by its goal."""
    MANUAL = "manual"
    """An operator, by manual set-points."""
    HOLD = "hold"
    """No source: the manual set-points stopped, and the vehicle holds."""
    PILOT = "pilot"
    """The safety pilot: the switch of the vehicle is at manual; it holds without set-points of the sticks."""


class DriveEvent(OpenEnum):
    """Event that changes the mode."""

    DRIVE = "drive"
    """An operator asks for the stick."""
    SETPOINT = "setpoint"
    """A manual set-point of the operator who has the stick."""
    EXPIRED = "expired"
    """The last manual set-point is older than its time-out."""
    RELEASE = "release"
    """The operator releases the stick."""
    ORDER = "order"
    """An operator orders a manoeuvre: takeoff, goto, hold, land or return."""
    RECOVERY = "recovery"
    """The mission manager brings the vehicle to safety: a mission failed, or the link is lost."""
    SWITCH_MANUAL = "switch_manual"
    """The safety pilot sets the switch to manual."""
    SWITCH_AUTO = "switch_auto"
    """The safety pilot sets the switch to auto."""


@register
class Drive(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Command to the chassis (board `act/drive`): velocity in the body frame, mode and source."""

    vx_m_s: Finite
    vy_m_s: Finite = 0.0
    vz_m_s: Finite = 0.0
    wz_rad_s: Finite = 0.0
    mode: DriveMode = DriveMode.AUTO
    source: str = ""
    """navigator, the operator who has the stick, pilot, or "" if the vehicle holds."""

    @property
    def setpoint(self) -> Setpoint:
        """The velocity without mode and source."""
        return Setpoint(self.vx_m_s, self.vy_m_s, self.vz_m_s, self.wz_rad_s)


@register
class ControlState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The mode of a vehicle, with its holder, since when and why (board `control/state`)."""

    mode: DriveMode
    holder: str = ""
    """Operator who has the stick (`operator@gcs`), or "" if no operator has it."""
    holder_id: int = 0
    """Application of the holder (hardware id · 2³² + application id), or 0 if no operator has the stick."""
    since_ns: int = 0
    """Own hardware clock when this mode began."""
    event: str = ""
    """Event that led to this mode."""


@register
class DriveRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request the stick, release it, or pass the vehicle to the navigator (`sys/vehicle/drive`)."""

    event: DriveEvent
    """drive, release, order or recovery."""
    take: bool = False
    """drive: take the stick from the operator who has it."""


@register
class RemoteLink(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Radio link from the safety pilot's transmitter to its receiver (board `vehicle/remote`)."""

    linked: bool
    """Whether valid frames of the transmitter arrive."""


@register
class SafetySwitch(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Position of the safety pilot's switch (board `vehicle/switch`)."""

    mode: VehicleMode


@register
class SwitchRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Set the switch of a simulated vehicle (`sys/sim/switch`)."""

    mode: VehicleMode
