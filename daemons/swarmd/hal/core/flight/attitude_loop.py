"""Attitude loop: commands body rates for roll, pitch and yaw rate."""

import math

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.geometry.attitude import Vector


def body_rates(
    state: FlightState,
    roll_rad: float,
    pitch_rad: float,
    yaw_rate_rad_s: float,
    kp_1_s: float,
    limit_rad_s: float,
) -> Vector:
    """Commanded body rates for a commanded roll, pitch and yaw rate.

    Source: Beard, McLain 2012, "Small Unmanned Aircraft", equation 3.3.
    """
    roll_rate = _clipped(kp_1_s * (roll_rad - state.roll_rad), limit_rad_s)
    pitch_rate = _clipped(kp_1_s * (pitch_rad - state.pitch_rad), limit_rad_s)
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    return (
        roll_rate - sp * yaw_rate_rad_s,
        cr * pitch_rate + sr * cp * yaw_rate_rad_s,
        -sr * pitch_rate + cr * cp * yaw_rate_rad_s,
    )


def _clipped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
