"""Pauses of the processes of a flying vehicle, alone and together, in gusts: loss of height and outcome
(ADR 69).

`python -m tests.simulation.flight.starvation` prints the figures by the length of the pause.
"""

import math

import msgspec
import pytest
from tests.simulation.flight.starvation import (
    GUSTS,
    PARTS,
    TOGETHER,
    PauseFigures,
    StarvedFlight,
    hovering,
    pause,
)
from tests.simulation.seeds import cases, seeds

from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import WindConfig
from swarmware.types.navigation import Goal, GoalKind

BREEZE = SimConfig(wind=WindConfig(mean_m_s=(2.0, 1.0, 0.0), gust_sigma_m_s=0.3, gust_tau_s=2.0))
"""Wind of the helicopter, whose height varies by more than half a metre in stronger gusts without any
pause."""
WIND = {"quad_1k5": GUSTS, "hexa_14k": GUSTS, "helicopter": BREEZE}
AIRFRAMES = pytest.mark.parametrize("airframe", list(WIND))
MULTIROTORS = pytest.mark.parametrize("airframe", ["quad_1k5", "hexa_14k"])
SEEDS = pytest.mark.parametrize("seed", [number + 1 for number in seeds(1, 12)])
STEPS = frozenset({"hal", "sim"})
"""Parts without which no control step is made."""


def check_flying(found: PauseFigures) -> None:
    assert found.level_s <= 2.0, found
    assert found.overshoot_m < 1.0, found
    assert not found.touched, found


@SEEDS
@AIRFRAMES
@pytest.mark.parametrize("parts", TOGETHER, ids="+".join)
def test_half_second_pause_costs_half_metre(parts: tuple[str, ...], airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed, WIND[airframe])
    for longest_s in cases([0.3, 0.5], [0.15, 0.5]):
        flight.run(flight.rng.uniform(0.0, 2.0))
        found = pause(flight, parts, flight.rng.uniform(0.06, longest_s))
        assert found.lost_m <= 0.5, found
        assert not found.motors_stopped, found
        check_flying(found)
        assert ("flight/loop late" in found.states) is bool(STEPS & set(parts)), found


@SEEDS
@AIRFRAMES
@pytest.mark.parametrize("parts", TOGETHER, ids="+".join)
def test_outputs_hold_for_second_and_pause_is_error(parts: tuple[str, ...], airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed + 100, WIND[airframe])
    for longest_s in cases([0.98], [0.98]):
        flight.run(flight.rng.uniform(0.0, 2.0))
        found = pause(flight, parts, flight.rng.uniform(0.55, longest_s))
        assert found.lost_m <= 1.0, found
        assert not found.motors_stopped, found
        check_flying(found)
        assert ("flight/loop away" in found.states) is bool(STEPS & set(parts)), found


@SEEDS
@MULTIROTORS
@pytest.mark.parametrize("parts", [parts for parts in TOGETHER if STEPS & set(parts)], ids="+".join)
def test_stopped_motors_restart_when_loop_returns_in_time(
    parts: tuple[str, ...], airframe: str, seed: int
) -> None:
    flight = hovering(airframe, seed + 200, WIND[airframe], height_m=10.0)
    found = pause(flight, parts, flight.rng.uniform(1.1, 1.5))
    assert found.motors_stopped, found
    assert "flight/loop away" in found.states, found
    assert found.lost_m < 5.0, found
    check_flying(found)


@SEEDS
@AIRFRAMES
def test_flight_that_was_left_for_longer_is_ended(airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed + 300, WIND[airframe], height_m=30.0)
    found = pause(flight, ("hal",), flight.rng.uniform(2.1, 2.4))
    assert found.motors_stopped, found
    assert "flight/loop lost" in found.states, found
    assert not flight.simulation.vehicle.armed
    assert found.overshoot_m < 1.0, found


@SEEDS
@MULTIROTORS
def test_vehicle_grounded_during_pause_does_not_rise(airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed + 400, WIND[airframe], height_m=1.5)
    found = pause(flight, ("hal",), 1.9)
    flight.run(10.0)
    assert found.touched, found
    assert flight.simulation.vehicle.landed
    assert {"flight/loop lost", "flight/contact touched"} & set(found.states), found


@SEEDS
@AIRFRAMES
def test_killed_flight_controller_is_replaced_in_flight(airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed + 500, WIND[airframe])
    for longest_s in (0.4, 0.9):
        flight.run(flight.rng.uniform(0.5, 2.0))
        found = pause(flight, ("hal",), flight.rng.uniform(0.25, longest_s), kill=True)
        assert not found.motors_stopped, found
        assert found.lost_m < 1.0, found
        check_flying(found)
        assert {"flight/loop late", "flight/loop away"} & set(found.states), found


@SEEDS
@MULTIROTORS
def test_moving_vehicle_is_level_after_pause(airframe: str, seed: int) -> None:
    flight = hovering(airframe, seed + 600, WIND[airframe], height_m=10.0)
    for number, (x_m, y_m) in enumerate(((20.0, 0.0), (0.0, 20.0), (-20.0, -5.0)), 3):
        flight.goal(Goal(number, GoalKind.GOTO, x_m=x_m, y_m=y_m, z_m=10.0, speed_m_s=2.0))
        flight.run(flight.rng.uniform(2.0, 4.0))
        found = pause(flight, PARTS, flight.rng.uniform(0.1, 0.5))
        assert found.lost_m <= 0.5, found
        check_flying(found)


@SEEDS
@MULTIROTORS
@pytest.mark.parametrize("away_s", [0.05, 0.33])
def test_repeatedly_late_loop_keeps_vehicle_in_air(airframe: str, seed: int, away_s: float) -> None:
    """At 3 Hz a vehicle tilted by 29° and touched the ground before, and no fault said so."""
    flight = hovering(airframe, seed + 700, WIND[airframe])
    begin, tilt_deg, places = flight.truth, 0.0, list[tuple[float, float, float]]()

    def watch(now: StarvedFlight) -> None:
        nonlocal tilt_deg
        tilt_deg = max(tilt_deg, math.degrees(now.tilt_rad))
        pose = now.simulation.vehicle.pose()
        places.append((pose.x_m, pose.y_m, pose.z_m))

    flight.conditions.clear()
    end_s = flight.time_s + 10.0
    while flight.time_s < end_s:
        flight.pause(("hal",), flight.rng.uniform(0.5, 1.5) * away_s)
        flight.run(away_s * 1.5, lambda _: watch(flight))
    assert tilt_deg < 30.0
    assert max(abs(z_m - begin.z_m) for *_, z_m in places) < 1.0
    assert max(math.dist((x_m, y_m), (begin.x_m, begin.y_m)) for x_m, y_m, _ in places) < 15.0
    worst = {0.05: "flight/loop late", 0.33: "flight/loop starved"}[away_s]
    assert worst in flight.states


def test_vehicle_without_held_outputs_is_lost() -> None:
    """Counter-example for the setting: the same pause with motors that stop at once."""

    def lost_m(held_s: float) -> float:
        flight = hovering("quad_1k5", 3)
        body = msgspec.structs.replace(flight.airframe.body, outputs_held_s=held_s)
        flight.simulation._held_ns = round(body.outputs_held_s * 1e9)
        return pause(flight, ("hal",), 0.8).lost_m

    assert lost_m(0.05) > 2.0
    assert lost_m(1.0) < 0.5
