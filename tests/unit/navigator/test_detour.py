"""The free direction: straight without obstacles, around an obstacle on one side, without changing the
side."""

import math

import pytest

from swarmd.navigator.config import DwaConfig
from swarmd.navigator.core.detour import Detour
from swarmd.navigator.core.target import MovingObstacle, Surroundings
from swarmware.types.vehicle import Pose

HERE = Pose.planar(0.0, 0.0)
AHEAD = (2.0, 0.0)


def turn(detour: Detour, around: Surroundings, pose: Pose = HERE, reach_m: float = 4.0) -> float:
    """Degrees by which the aim lies to the left of the wanted point."""
    x, y = detour.aim(pose, AHEAD, reach_m, around)
    assert math.dist((x, y), (pose.x_m, pose.y_m)) == pytest.approx(math.dist(AHEAD, (pose.x_m, pose.y_m)))
    wanted = math.atan2(AHEAD[1] - pose.y_m, AHEAD[0] - pose.x_m)
    return math.degrees(math.atan2(y - pose.y_m, x - pose.x_m) - wanted)


@pytest.mark.parametrize(
    "around",
    [
        Surroundings(),
        Surroundings(((-2.0, 0.0),)),
        Surroundings(((3.0, 1.0),)),
        Surroundings(((6.0, 0.0),)),
        Surroundings((), (MovingObstacle(3.0, 0.0, 0.0, 1.0, 0.0, 0.0),)),
        Surroundings((), (MovingObstacle(3.0, 0.0, 8.0, 0.0, 0.0, 0.0),)),
    ],
    ids=["nothing", "behind", "beside", "far", "moving", "above"],
)
def test_what_is_not_in_the_way_bends_nothing(around: Surroundings) -> None:
    assert Detour(DwaConfig()).aim(HERE, AHEAD, 4.0, around) == AHEAD


@pytest.mark.parametrize(("y", "left"), [(-0.3, True), (0.3, False)])
def test_it_goes_around_on_the_shorter_side(y: float, left: bool) -> None:
    angle = turn(Detour(DwaConfig()), Surroundings(((3.0, y),)))
    assert 5 < abs(angle) < 40
    assert (angle > 0) is left


def test_standing_platform_is_passed_by_own_width() -> None:
    point = abs(turn(Detour(DwaConfig()), Surroundings(((2.0, 0.1),))))
    platform = abs(
        turn(Detour(DwaConfig()), Surroundings((), (MovingObstacle(2.0, 0.1, 0.0, 0.0, 0.0, 0.0),)))
    )
    assert platform > point


def test_detour_keeps_side_for_small_advantage() -> None:
    detour = Detour(DwaConfig())
    first = turn(detour, Surroundings(((3.0, -0.2),)))
    second = turn(detour, Surroundings(((3.0, 0.2),)))
    assert first > 0
    assert second > 0
    assert turn(detour, Surroundings()) == pytest.approx(0.0)
    assert turn(detour, Surroundings(((3.0, 0.2),))) < 0


def test_blocked_detour_leaves_rest_to_planner() -> None:
    ring = tuple((math.cos(a / 10), math.sin(a / 10)) for a in range(63))
    assert Detour(DwaConfig()).aim(HERE, AHEAD, 4.0, Surroundings(ring)) == AHEAD
