"""The helicopter in virtual time: hover over minutes, a way, wind, landing, with the cores of a node."""

import math

import pytest
from tests.simulation.flight.hover import measure, risen
from tests.simulation.flight.vehicle import Flight
from tests.simulation.seeds import seeds

from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import WindConfig
from swarmware.types.chassis import ChassisAction
from swarmware.types.navigation import Goal, GoalKind, NavState

SEEDS = [number + 1 for number in seeds(1, 10)]
DURATION_S = 300.0 if len(SEEDS) == 10 else 60.0


@pytest.mark.parametrize("seed", SEEDS)
def test_vehicle_hovers_within_two_degrees(seed: int) -> None:
    found = measure("helicopter", seed, DURATION_S)
    assert found.largest_deg <= 2.0, found
    assert found.beyond_ratio <= 0.05, found
    assert found.height_m < 0.3, found
    assert found.place_m < 0.5, found
    assert found.collisions == 0, found


def test_helicopter_reaches_place_settles_and_lands_softly() -> None:
    flight = risen("helicopter", 2)
    flight.goal(Goal(3, GoalKind.GOTO, x_m=10.0, y_m=15.0, z_m=6.0, speed_m_s=3.0))
    flight.run_until(lambda f: f.status.goal_seq == 3 and f.status.state is NavState.ARRIVED, 40.0)
    flight.run(5.0)
    places: list[float] = []
    flight.run(10.0, lambda f: places.append(math.dist((f.truth.x_m, f.truth.y_m), (10.0, 15.0))))
    assert max(places) < 0.5
    flight.goal(Goal(4, GoalKind.LAND, speed_m_s=1.0))
    flight.run_until(lambda f: f.status.goal_seq == 4 and f.status.state is NavState.ARRIVED, 30.0)
    assert flight.truth.z_m == 0.0
    assert not flight.order(ChassisAction.DISARM)
    assert flight.collisions == []


def test_in_wind_with_gusts_it_keeps_its_place() -> None:
    wind = WindConfig(mean_m_s=(4.0, 2.0, 0.0), gust_sigma_m_s=1.0, gust_tau_s=2.0)
    flight = risen("helicopter", 3, SimConfig(wind=wind))
    flight.run(5.0)
    first, places = flight.truth, [0.0]
    flight.run(40.0, lambda f: places.append(math.dist((f.truth.x_m, f.truth.y_m), (first.x_m, first.y_m))))
    assert max(places) < 1.0
    assert max(map(abs, flight.tilt_deg)) < 15.0
    assert flight.collisions == []


def test_killed_in_the_air_it_falls() -> None:
    flight = risen("helicopter", 4)
    flight.order(ChassisAction.KILL)
    flight.run(5.0)
    assert flight.truth.z_m == 0.0
    assert [hit.other for hit in flight.collisions] == ["ground"]


def test_without_outputs_its_rotor_stops() -> None:
    """The servos of a real helicopter hold their position; the motor controller stops the rotor only."""
    flight = risen("helicopter", 5)

    def silent(flight: Flight) -> None:
        flight.simulation.advance(flight.now_ns)
        flight.now_ns += 10_000_000

    height_m = flight.truth.z_m
    for _ in range(400):
        silent(flight)
    assert flight.simulation.vehicle.pose().z_m < height_m - 1.0
