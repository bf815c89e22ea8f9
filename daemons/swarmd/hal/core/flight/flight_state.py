"""Estimated state of a flying vehicle, the input of its controllers."""

import msgspec

from swarmware.geometry.attitude import Vector


class FlightState(msgspec.Struct, frozen=True, gc=False):
    """Attitude, rates and motion of a vehicle at one instant."""

    roll_rad: float
    pitch_rad: float
    """Pitch, positive with the nose down."""
    yaw_rad: float
    rates_rad_s: Vector
    """Rates about the body axes, without the gyro's bias."""
    position_m: Vector
    """Position east, north and up, relative to the first fix."""
    velocity_m_s: Vector
    """Velocity to the east, to the north and up."""
