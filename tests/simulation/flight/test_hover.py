"""Hover, wind, steps of velocity, wrong echoes: the cores of simulation and flight control together."""

import math

import pytest
from tests.simulation.flight.hover import HEIGHT_M, measure, risen
from tests.simulation.flight.vehicle import Flight
from tests.simulation.seeds import seeds

from swarmd.hal.core.median import MedianFilter
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import SensorsConfig, WindConfig
from swarmware.model.airframe import MultirotorAirframe
from swarmware.types.chassis import ChassisAction
from swarmware.types.navigation import Goal, GoalKind, NavState
from swarmware.types.vehicle import Setpoint

AIRFRAMES = pytest.mark.parametrize("airframe", ["quad_1k5", "hexa_14k"])


SEEDS = [number + 1 for number in seeds(1, 20)]
DURATION_S = 300.0 if len(SEEDS) == 20 else 60.0


@pytest.mark.timeout(900)  # five minutes of flight are 20 s of a processor
@pytest.mark.parametrize("seed", SEEDS)
@AIRFRAMES
def test_hover_stays_within_two_degrees(airframe: str, seed: int) -> None:
    found = measure(airframe, seed, DURATION_S)
    assert found.largest_deg <= 2.0, found
    assert found.beyond_ratio <= 0.01, found
    assert found.height_m < 0.3, found
    assert found.place_m < 0.5, found
    assert found.collisions == 0, found


def speed_m_s(flight: Flight) -> float:
    return math.hypot(flight.truth.vx_m_s, flight.truth.vy_m_s)


@AIRFRAMES
def test_velocity_step_is_followed_with_small_overshoot(airframe: str) -> None:
    flight = risen(airframe, 1)
    height_m = flight.truth.z_m
    flight.commands = lambda _: Setpoint(2.0)
    fastest, lowest, highest, tilt = 0.0, height_m, height_m, 0.0

    def watch(now: Flight) -> None:
        nonlocal fastest, lowest, highest, tilt
        fastest = max(fastest, speed_m_s(now))
        lowest, highest = min(lowest, now.truth.z_m), max(highest, now.truth.z_m)
        tilt = max(tilt, *map(abs, now.tilt_deg))

    flight.run(2.5, watch)
    assert speed_m_s(flight) > 1.6
    flight.run(5.0, watch)
    assert speed_m_s(flight) == pytest.approx(2.0, abs=0.25)
    assert fastest < 2.6
    assert highest - lowest < 0.35
    assert isinstance(flight.airframe, MultirotorAirframe)
    assert 5.0 < tilt <= math.degrees(flight.airframe.limits.tilt_max_rad) + 5.0
    flight.commands = lambda _: Setpoint(0.0)
    flight.run(6.0)
    assert speed_m_s(flight) < 0.2


@AIRFRAMES
def test_a_climb_and_a_turn_are_followed_together(airframe: str) -> None:
    flight = risen(airframe, 2)
    before = flight.truth
    flight.commands = lambda _: Setpoint(0.0, 0.0, 1.0, 0.5)
    flight.run(4.0)
    after = flight.truth
    assert after.z_m - before.z_m == pytest.approx(4.0, abs=0.6)
    assert math.remainder(after.yaw_rad - before.yaw_rad - 2.0, math.tau) == pytest.approx(0.0, abs=0.3)
    assert after.wz_rad_s == pytest.approx(0.5, abs=0.1)


@AIRFRAMES
def test_in_wind_with_gusts_it_keeps_its_place(airframe: str) -> None:
    wind = WindConfig(mean_m_s=(4.0, 2.0, 0.0), gust_sigma_m_s=1.0, gust_tau_s=2.0)
    flight = risen(airframe, 3, SimConfig(wind=wind))
    first = flight.truth
    farthest, lowest, highest = 0.0, first.z_m, first.z_m

    def watch(now: Flight) -> None:
        nonlocal farthest, lowest, highest
        farthest = max(farthest, math.hypot(now.truth.x_m - first.x_m, now.truth.y_m - first.y_m))
        lowest, highest = min(lowest, now.truth.z_m), max(highest, now.truth.z_m)

    flight.run(40.0, watch)
    assert farthest < 1.0
    assert highest - lowest < 0.8
    assert max(map(abs, flight.tilt_deg)) < 15.0


@pytest.mark.parametrize("ratio", [0.0, 0.15])
def test_false_sonar_echoes_do_not_move_vehicle(ratio: float) -> None:
    sensors = SensorsConfig(sonar_outliers_ratio=ratio)
    found = measure("quad_1k5", 4, 40.0, SimConfig(sensors=sensors))
    assert found.height_m < 0.2
    assert found.largest_deg < 2.0


def test_echoes_without_median_filter_move_vehicle() -> None:
    sensors = SensorsConfig(sonar_outliers_ratio=0.15)
    heights: list[float] = []

    def spread(window: int) -> float:
        flight = risen("quad_1k5", 4, SimConfig(sensors=sensors))
        flight.median = MedianFilter(window)
        heights.clear()
        flight.run(30.0, lambda now: heights.append(now.truth.z_m))
        return max(heights) - min(heights)

    assert spread(1) > 1.5 * spread(5)


def test_gains_change_in_flight_and_high_ones_oscillate() -> None:
    flight = risen("quad_1k5", 5)
    flight.core.controller.set_gains({"velocity_kp_1_s": 1.0})
    tilts: list[float] = []

    def worst_deg() -> float:
        tilts.clear()
        flight.run(5.0, lambda now: tilts.append(max(map(abs, now.tilt_deg))))
        return max(tilts)

    before_deg = worst_deg()
    flight.core.controller.set_gains({"rate_kp_1_s": 150.0})
    assert worst_deg() > max(2 * before_deg, 1.0)


def test_outputs_that_stop_arriving_stop_the_motors() -> None:
    flight = risen("quad_1k5", 6)
    flight.core.on_setpoint(Setpoint(0.0))
    end_ns = flight.now_ns + 3_000_000_000
    while flight.now_ns < end_ns:  # only the simulation goes on
        flight.now_ns += 10_000_000
        flight.simulation.advance(flight.now_ns)
    assert flight.simulation.vehicle.landed


def test_kill_in_air_drops_vehicle_and_prevents_arming() -> None:
    flight = risen("hexa_14k", 7)
    assert flight.order(ChassisAction.KILL) == ""
    flight.run(0.3)
    assert flight.truth.vz_m_s == pytest.approx(-0.3 * 9.81, rel=0.2)
    assert "arming in the air" in flight.order(ChassisAction.ARM)
    flight.run(3.0)
    assert flight.simulation.vehicle.landed
    assert [hit.other for hit in flight.collisions] == ["ground"]


@AIRFRAMES
def test_it_goes_to_a_place_and_lands_softly(airframe: str) -> None:
    flight = risen(airframe, 8)
    here = flight.truth
    goal = Goal(3, GoalKind.GOTO, here.x_m + 8.0, here.y_m - 4.0, HEIGHT_M + 1.0, speed_m_s=2.0)
    flight.goal(goal)
    flight.run_until(lambda f: f.status.goal_seq == 3 and f.status.state is NavState.ARRIVED, 30.0)
    flight.run(3.0)
    assert math.dist((flight.truth.x_m, flight.truth.y_m), (goal.x_m, goal.y_m)) < 0.4
    flight.goal(Goal(4, GoalKind.LAND))
    flight.run_until(lambda f: f.status.goal_seq == 4 and f.status.state is NavState.ARRIVED, 40.0)
    assert flight.order(ChassisAction.DISARM) == ""
    assert not flight.collisions
    flight.run(2.0)
    assert flight.truth.z_m == 0.0
