"""Points of a turn become one distance for each direction: no ground, no vehicle, no dust."""

import math
from typing import Any

import numpy as np
import pytest
from tests.unit.lidar.packets import Surroundings, ground, turn, wall

from swarmd.lidar.config import Config
from swarmd.lidar.core.obstacle_model import ObstacleModel
from swarmd.lidar.core.turn_decoder import TurnDecoder
from swarmware.geometry.attitude import levelled
from swarmware.types.vehicle import Range


def points(surroundings: Surroundings) -> Any:
    packets = turn(surroundings)
    (found,) = TurnDecoder().turns([*packets, packets[0]], 0)
    return found.points


def scan(rows: Any, roll_rad: float = 0.0, pitch_rad: float = 0.0, **settings: float) -> Range:
    config = Config(**settings)  # type: ignore[arg-type]  # numbers of a test
    return ObstacleModel(config).ranges(np.asarray(rows, "f4"), roll_rad, pitch_rad)


def test_wall_ahead_is_near_only_in_front() -> None:
    found = scan(points(wall(5.0)))
    assert found.angle_min_rad == 0.0
    assert found.angle_step_rad == pytest.approx(math.radians(10))
    assert found.ranges_m[0] == pytest.approx(5.0, abs=0.05)
    assert found.ranges_m[3] == pytest.approx(5.0 / math.cos(math.radians(25)), abs=0.1), (
        "30 ± 5 degrees left"
    )
    assert found.ranges_m[33] == pytest.approx(found.ranges_m[3], abs=0.1)
    assert found.ranges_m[10:27] == (100.0,) * 17


def test_ground_is_no_obstacle_also_when_vehicle_tilts() -> None:
    flat = points(ground(1.0))
    assert min(scan(flat).ranges_m) == 100.0
    pitch = math.radians(12.0)
    # what a vehicle whose nose points down sees: the same ground in its own axes
    tilted = [levelled((float(x), float(y), float(z)), 0.0, -pitch) for x, y, z in flat]
    assert min(scan(tilted, 0.0, pitch).ranges_m) == 100.0
    assert min(scan(tilted).ranges_m) < 20.0, "without its attitude the ground ahead would be a wall"


@pytest.mark.parametrize(("echoes", "distance_m"), [(1, 3.0), (2, 3.0), (3, 8.0)])
def test_fewer_points_than_an_obstacle_has_are_dust(echoes: int, distance_m: float) -> None:
    dust = [(3.0, 0.0, 0.0), (3.0, 0.1, 0.0)]
    tree = [(8.0, 0.1 * number, 0.0) for number in range(5)]
    assert scan([*dust, *tree], echoes=echoes).ranges_m[0] == pytest.approx(distance_m, abs=0.1)


def test_points_outside_reach_or_height_are_ignored() -> None:
    rows = [(0.5, 0.0, 0.0)] * 5 + [(30.0, 0.0, 0.0)] * 5 + [(4.0, 0.0, 2.0)] * 5 + [(4.0, 0.0, -1.0)] * 5
    assert scan(rows, max_m=20.0).ranges_m[0] == 20.0
    assert scan(rows, max_m=40.0).ranges_m[0] == 30.0
    assert scan(rows, high_m=2.5).ranges_m[0] == 4.0


def test_each_direction_has_its_own_distance() -> None:
    rows = [
        (number * math.cos(math.radians(10 * beam)), number * math.sin(math.radians(10 * beam)), 0.0)
        for beam in range(36)
        for number in [2.0 + beam] * 3
    ]
    assert scan(rows).ranges_m == pytest.approx([2.0 + beam for beam in range(36)], abs=1e-3)


def test_without_points_nothing_is_near() -> None:
    assert scan(np.zeros((0, 3))).ranges_m == (100.0,) * 36
