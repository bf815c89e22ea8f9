"""The fixed wing in virtual time, with the cores of a node: launch, waypoints, loiter, wind, landing.

`python -m tests.simulation.flight.test_fixed_wing` prints the figures of five seeds.
"""

import math
import sys

import msgspec
import pytest
from tests.simulation.flight.vehicle import Flight
from tests.simulation.seeds import seeds

from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import WindConfig
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.types.chassis import ChassisAction
from swarmware.types.navigation import Goal, GoalKind, NavState
from swarmware.types.vehicle import Setpoint

HEIGHT_M = 40.0
SQUARE = ((300.0, 0.0), (300.0, 300.0), (0.0, 300.0), (0.0, 0.0))


class LoiterFigures(msgspec.Struct, frozen=True):
    """Extremes of a loiter around the last waypoint, and of the landing after it."""

    radius_m: tuple[float, float]
    height_m: tuple[float, float]
    speed_m_s: tuple[float, float]
    landed_m: float
    """Distance of the place of rest from where it was when the landing was ordered."""
    collisions: int


def limits(flight: Flight) -> FixedWingAirframe:
    assert isinstance(flight.airframe, FixedWingAirframe)
    return flight.airframe


def launched(seed: int, config: SimConfig | None = None) -> Flight:
    flight = Flight("fixed_wing", seed, config, world="airfield")
    flight.run(2.0)
    refused = flight.order(ChassisAction.ARM)
    assert not refused, refused
    flight.goal(Goal(1, GoalKind.TAKEOFF, z_m=HEIGHT_M, speed_m_s=3.0))
    until(flight, 1, NavState.ARRIVED, 40.0)
    return flight


def until(flight: Flight, seq: int, state: NavState, limit_s: float) -> None:
    flight.run_until(lambda f: f.status.goal_seq == seq and f.status.state is state, limit_s)


def go(flight: Flight, seq: int, x_m: float, y_m: float) -> None:
    flight.goal(Goal(seq, GoalKind.GOTO, x_m=x_m, y_m=y_m, z_m=HEIGHT_M, speed_m_s=22.0))
    until(flight, seq, NavState.ARRIVED, 60.0)


def land(flight: Flight, seq: int, place: tuple[float, float] | None = None) -> float:
    """Distance of the place of rest from another, else from where the landing was ordered."""
    x, y = place or (flight.truth.x_m, flight.truth.y_m)
    flight.goal(Goal(seq, GoalKind.LAND, speed_m_s=1.0))
    until(flight, seq, NavState.ARRIVED, 200.0)
    assert math.hypot(flight.truth.vx_m_s, flight.truth.vy_m_s) < 1.0, "it still rolls"
    return math.dist((flight.truth.x_m, flight.truth.y_m), (x, y))


def measure(seed: int, duration_s: float, config: SimConfig | None = None) -> LoiterFigures:
    """Flies the square, circles around its last corner, and lands."""
    flight = launched(seed, config)
    for index, (x, y) in enumerate(SQUARE):
        go(flight, 2 + index, x, y)
    flight.run(20.0)
    radii: list[float] = []
    heights: list[float] = []
    speeds: list[float] = []

    def sample(now: Flight) -> None:
        pose = now.truth
        radii.append(math.dist((pose.x_m, pose.y_m), SQUARE[-1]))
        heights.append(pose.z_m)
        speeds.append(math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s))

    flight.run(duration_s, sample)
    landed_m = land(flight, 6, SQUARE[-1])
    return LoiterFigures(span(radii), span(heights), span(speeds), landed_m, len(flight.collisions))


def span(values: list[float]) -> tuple[float, float]:
    return min(values), max(values)


SEEDS = [number + 1 for number in seeds(1, 10)]
LOITER_S = 60.0 if len(SEEDS) == 10 else 20.0


@pytest.mark.parametrize("seed", SEEDS)
def test_aircraft_flies_square_loiters_and_lands_near_place(seed: int) -> None:
    found = measure(seed, LOITER_S)
    assert 85.0 < found.radius_m[0] < found.radius_m[1] < 95.0, found
    assert 38.5 < found.height_m[0] < found.height_m[1] < 41.5, found
    assert 21.0 < found.speed_m_s[0] < found.speed_m_s[1] < 23.0, found
    assert found.landed_m < 25.0, found
    assert found.collisions == 0, found


def test_hold_is_circle_that_begins_where_it_is() -> None:
    flight = launched(2)
    flight.goal(Goal(2, GoalKind.HOLD))
    until(flight, 2, NavState.HOLDING, 10.0)
    first, ways = flight.truth, [0.0]
    flight.run(60.0, lambda f: ways.append(math.dist((f.truth.x_m, f.truth.y_m), (first.x_m, first.y_m))))
    assert 120.0 < max(ways) < 2 * limits(flight).limits.loiter_radius_m + 10.0
    assert flight.status.state is NavState.HOLDING
    assert flight.truth.z_m == pytest.approx(first.z_m, abs=2.0)


def test_aircraft_without_velocity_stays_in_circle() -> None:
    """Without a navigator the fail-safe commands zero velocity, and the aircraft circles."""
    flight = launched(3)
    flight.commands = lambda _: Setpoint(0.0)
    flight.run(10.0)
    first, ways = flight.truth, [0.0]
    flight.run(60.0, lambda f: ways.append(math.dist((f.truth.x_m, f.truth.y_m), (first.x_m, first.y_m))))
    assert max(ways) < 2.3 * limits(flight).limits.loiter_radius_m
    assert flight.truth.z_m == pytest.approx(first.z_m, abs=1.5)
    assert flight.collisions == []


def test_hand_steered_aircraft_turns_without_stall() -> None:
    flight = launched(4)
    flight.commands = lambda _: Setpoint(3.0)
    flight.run(15.0)
    slowest = math.inf

    def watch(now: Flight) -> None:
        nonlocal slowest
        slowest = min(slowest, math.hypot(now.truth.vx_m_s, now.truth.vy_m_s))

    before = flight.truth
    flight.run(20.0, watch)
    assert slowest > limits(flight).stall_m_s + 1.0
    assert flight.truth.z_m == pytest.approx(before.z_m, abs=3.0)
    flight.commands = lambda _: Setpoint(20.0, 0.0, 0.0, 0.1)
    yaw = flight.truth.yaw_rad
    flight.run(5.0)
    assert math.remainder(flight.truth.yaw_rad - yaw, math.tau) > 0.2


@pytest.mark.parametrize("seed", [number + 1 for number in seeds(1, 5)])
def test_in_wind_with_gusts_it_loiters_and_lands(seed: int) -> None:
    wind = WindConfig(mean_m_s=(2.5, 1.0, 0.0), gust_sigma_m_s=0.5, gust_tau_s=2.0)
    found = measure(seed, LOITER_S, SimConfig(wind=wind))
    assert 75.0 < found.radius_m[0] < found.radius_m[1] < 105.0, found
    assert 30.0 < found.height_m[0] < found.height_m[1] < 50.0, found
    assert found.collisions == 0, found


def test_the_attitude_is_known_after_minutes_of_turning() -> None:
    """In a turn the accelerometer does not show the vertical: the acceleration of the turn is taken off."""
    flight = launched(5)
    flight.goal(Goal(2, GoalKind.HOLD))
    flight.run(150.0)
    state = flight.core.state()
    roll, pitch = flight.tilt_deg
    assert abs(roll) > 20.0
    assert math.degrees(state.roll_rad) == pytest.approx(roll, abs=1.5)
    assert math.degrees(state.pitch_rad) == pytest.approx(pitch, abs=1.5)


if __name__ == "__main__":
    for number in range(1, 6):
        sys.stdout.write(f"{number} {measure(number, 120.0)}\n")
