"""The cut of a flight around a fault, for the log."""

import msgspec

from swarmware.types.registry import register


@register
class FlightRecordRow(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One control step of a flight: estimated attitude and motion, and the outputs."""

    stamp_ns: int
    """Own hardware clock."""
    gap_s: float
    """Time since the inertial sample before: of a loop in time one period."""
    roll_rad: float
    pitch_rad: float
    height_m: float
    """Above the first position fix."""
    climb_m_s: float
    motors: tuple[float, ...] = ()
    """Output of each motor, from 0 to 1."""


@register
class FlightRecord(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The seconds before and after a fault of a flight (events `vehicle/flight_record`)."""

    reason: str
    """The checks that failed, each with its state: `flight/loop away`."""
    rows: tuple[FlightRecordRow, ...] = ()
    """At most 20 rows a second, oldest first."""
