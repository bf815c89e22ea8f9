"""Installed airframes, for tests of their controllers."""

from pathlib import Path

import pytest

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.geometry.attitude import Vector
from swarmware.model.airframe import MultirotorAirframe
from swarmware.model.airframe_file import load_airframe

SHARE = Path(__file__).parents[4] / "share/swarm"
BOTH = pytest.mark.parametrize("name", ["quad_1k5", "hexa_14k"])


def airframe(name: str = "quad_1k5") -> MultirotorAirframe:
    found = load_airframe(SHARE, name)
    assert isinstance(found, MultirotorAirframe)
    return found


def state(
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
    yaw_rad: float = 0.0,
    rates: Vector = (0.0, 0.0, 0.0),
    position: Vector = (0.0, 0.0, 2.0),
    velocity: Vector = (0.0, 0.0, 0.0),
) -> FlightState:
    return FlightState(roll_rad, pitch_rad, yaw_rad, rates, position, velocity)
