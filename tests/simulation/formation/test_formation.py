"""The main job in virtual time: every size of swarm forms, keeps its slots past obstacles, lands unhurt."""

import json
from pathlib import Path

import pytest
from tests.simulation.formation.flight import COURSE, ROOT, SPEED_M_S, Flight, Result
from tests.simulation.formation.late_flight import LateFlight
from tests.simulation.seeds import cases

from swarmware.geometry.course import Course

FOLDER = Path(ROOT) / "share/swarm/missions/formation"


def check(result: Result, mean_m: float = 0.5, worst_m: float = 3.0) -> None:
    assert result.collisions == []
    assert result.completed
    assert result.mean_error_m < mean_m
    assert max(result.errors_m) < worst_m
    assert result.least_separation_m > 1.0


def test_what_is_flown_here_is_the_shipped_mission() -> None:
    params = json.loads((FOLDER / "leader.json").read_text())["params"]
    assert tuple(map(tuple, params["course"])) == COURSE
    assert params["speed_m_s"] == SPEED_M_S


@pytest.mark.parametrize(
    ("nodes", "seed"),
    cases([(3, 1), (16, 9)], [(4, 2), (7, 5), (10, 304), (5, 3), (6, 4), (8, 6), (10, 7), (13, 8), (16, 10)]),
)
def test_a_swarm_of_any_size_flies_the_formation(nodes: int, seed: int) -> None:
    flight = Flight(nodes, seed)
    check(flight.fly())
    assert flight.result.formed_s < 30
    # the course and two seconds to start and to stop
    assert flight.result.duration_s < Course(COURSE).length_m / SPEED_M_S + 12


@pytest.mark.slow
@pytest.mark.parametrize("nodes", cases([9], [11, 12, 14, 15]))
def test_formation_forms_with_every_other_number_of_nodes(nodes: int) -> None:
    check(Flight(nodes, 101).fly())


@pytest.mark.parametrize(("nodes", "seed"), cases([(6, 21)], [(10, 21), (10, 22)]))
def test_formation_over_bad_radio_is_less_exact(nodes: int, seed: int) -> None:
    check(Flight(nodes, seed, loss_ratio=0.4, delay_ns=200_000_000).fly(), mean_m=0.8, worst_m=3.0)


@pytest.mark.parametrize(("nodes", "seed"), cases([(6, 31)], [(10, 31), (10, 32)]))
def test_formation_on_stalling_computers_stays_without_collision(nodes: int, seed: int) -> None:
    flight = Flight(nodes, seed)
    for vehicle in flight.vehicles:
        vehicle.stalls_hz = 0.2
    check(flight.fly(), mean_m=0.8, worst_m=3.0)


def test_formation_holds_while_its_leader_is_silent() -> None:
    flight = Flight(7, 41)
    assert flight.form()
    assert not flight.advance(limit_s=20.0)
    flight.radio.silent.add("ugv1")
    flight.until(lambda: False, 6.0)
    followers = [v for v in flight.vehicles if v.name != "ugv1"]
    assert all(v.status.state == "holding" for v in followers)
    assert all(v.status.error == "leader_lost" for v in followers)
    assert all(abs(v.truth.vx_m_s) < 0.2 for v in followers)
    flight.radio.silent.clear()
    assert flight.until(lambda: flight.all_say("arrived"), 90)
    assert flight.land()
    assert flight.result.collisions == []


@pytest.mark.parametrize("seed", cases([4, 17], [s for s in range(30) if s not in (4, 17)]))
def test_ground_vehicles_pass_between_obstacles_with_short_turns(seed: int) -> None:
    flight = LateFlight(32, seed, ("ugv1", "ugv7", "ugv9"))
    check(flight.fly(), mean_m=3.0, worst_m=15.0)
    assert flight.result.duration_s < 2 * Course(COURSE).length_m / SPEED_M_S


@pytest.mark.slow
@pytest.mark.parametrize("seed", cases([0], range(1, 4)))
def test_so_do_those_that_fly(seed: int) -> None:
    check(LateFlight(32, seed, ("ugv1", "uav1", "uav2", "uav6", "uav9")).fly(), mean_m=3.0, worst_m=15.0)
