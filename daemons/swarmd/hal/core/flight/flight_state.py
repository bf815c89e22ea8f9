"""Estimated state of a flying vehicle, as its controllers take it."""

import msgspec

from swarmware.geometry.attitude import Vector


class FlightState(msgspec.Struct, frozen=True, gc=False):
    """Attitude, rates and motion at one instant."""

    roll_rad: float
    pitch_rad: float
    """Positive with the nose down."""
    yaw_rad: float
    rates_rad_s: Vector
    """About the body axes, without the bias of the gyro."""
    position_m: Vector
    """East, north and up of the first fix."""
    velocity_m_s: Vector
    """To the east, to the north, up."""
