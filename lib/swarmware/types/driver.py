"""Drivers of the hardware abstraction: their state and timing, and the load of their lines."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register


class DriverState(OpenEnum):
    """State of a driver of the hardware abstraction."""

    RUNNING = "running"
    FAILSAFE = "failsafe"
    """The device of an actuator is in its safe state, because its set-points do not arrive."""
    WAITING = "waiting"
    """Waiting for its device."""
    FAILED = "failed"


@register
class DriverStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Timing statistics of one driver of the hardware abstraction."""

    name: str
    state: DriverState
    asked_hz: float
    real_hz: float
    """Achieved rate over the interval of the report."""
    worst_late_ms: float
    """Maximum lateness of a call over the interval of the report."""
    reads: int
    errors: int
    missed: int = 0
    """Periods that were skipped because a read or the computer was too slow."""
    note: str = ""
    actuator: bool = False
    """Whether the driver is the output half, which carries set-points to its device."""
    p99_late_ms: float = 0.0
    """Lateness that 99 of 100 calls over the interval of the report did not exceed."""


@register
class LineLoad(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Load that drivers put on one line or bus to their devices, by their settings."""

    device: str
    """Device file or interface: `/dev/i2c-1`, `can0`."""
    drivers: tuple[str, ...]
    asked_bit_s: float
    capacity_bit_s: float
    """Capacity, configured or as usual for its kind, or 0 if unknown."""


@register
class DriverTable(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The drivers of a platform (board `hal/drivers`)."""

    drivers: tuple[DriverStatus, ...] = ()
    lines: tuple[LineLoad, ...] = ()
    """Lines and buses that they use."""
