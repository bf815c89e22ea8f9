"""The controller of air vehicles: straight to a free target, and around obstacles."""

import math

import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController, avoid
from swarmd.navigator.core.target import MovingObstacle, Surroundings, Target
from swarmware.types.vehicle import Pose

CONFIG = Config()
HERE = Pose.planar(0.0, 0.0, 8.0)


def target(
    x: float, y: float, z: float = 8.0, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Target:
    return Target(x, y, z, None, 5.0, (x, y), velocity)


def test_towards_the_place_in_the_body_frame() -> None:
    pose = Pose.planar(0.0, 0.0, 8.0, math.pi / 2)
    setpoint = AirController(CONFIG).steer(pose, target(0.0, 3.0), Surroundings(), 1_000_000_000)
    assert setpoint.vx_m_s > 1.0
    assert setpoint.vy_m_s == pytest.approx(0.0, abs=1e-9)


def test_in_its_place_it_moves_with_it() -> None:
    setpoint = AirController(CONFIG).steer(HERE, target(0.0, 0.0, 8.0, (1.5, -0.5, 0.0)), Surroundings(), 1)
    assert (setpoint.vx_m_s, setpoint.vy_m_s) == pytest.approx((1.5, -0.5))


def test_it_is_never_faster_than_its_limit() -> None:
    setpoint = AirController(CONFIG).steer(HERE, target(100.0, 0.0, 8.0, (4.0, 3.0, 0.0)), Surroundings(), 1)
    assert math.hypot(setpoint.vx_m_s, setpoint.vy_m_s) == pytest.approx(CONFIG.air.v_max_m_s)


def test_a_free_way_is_not_bent() -> None:
    away = Surroundings(((5.0, 5.0),), (MovingObstacle(3.0, 3.0, 8.0, 0.0, 0.0, 0.0),))
    assert avoid(CONFIG, HERE, (2.0, 0.0, 0.3), away) == (2.0, 0.0, 0.3)


def test_one_on_the_way_is_flown_around() -> None:
    ahead = Surroundings((), (MovingObstacle(4.0, 0.0, 8.0, 0.0, 0.0, 0.0),))
    bent = avoid(CONFIG, HERE, (2.0, 0.0, 0.0), ahead)
    assert bent != (2.0, 0.0, 0.0)
    assert bent[0] > 0.0


def test_vehicle_too_close_may_fly_away() -> None:
    close = Surroundings((), (MovingObstacle(0.5, 0.0, 8.0, 0.0, 0.0, 0.0),))
    assert avoid(CONFIG, HERE, (-1.0, 0.0, 0.0), close) == (-1.0, 0.0, 0.0)
    assert avoid(CONFIG, HERE, (1.0, 0.0, 0.0), close)[0] <= 0.0


def test_a_tree_is_as_high_as_the_sky() -> None:
    tree = Surroundings(((3.0, 0.0),))
    bent = avoid(CONFIG, HERE, (2.0, 0.0, 2.0), tree)
    assert abs(math.atan2(bent[1], bent[0])) > 0.2 or math.hypot(bent[0], bent[1]) < 0.5


def test_one_high_above_is_not_avoided() -> None:
    above = Surroundings((), (MovingObstacle(3.0, 0.0, 12.0, 0.0, 0.0, 0.0),))
    assert avoid(CONFIG, HERE, (2.0, 0.0, 0.0), above) == (2.0, 0.0, 0.0)


def test_one_that_gives_way_is_given_less_room() -> None:
    def ahead(yields: bool) -> Surroundings:
        return Surroundings((), (MovingObstacle(6.0, 1.2, 8.0, -1.0, 0.0, 0.0, yields),))

    wanted = (2.0, 0.0, 0.0)
    assert avoid(CONFIG, HERE, wanted, ahead(True)) == wanted
    assert avoid(CONFIG, HERE, wanted, ahead(False)) != wanted


@pytest.mark.parametrize("angle_deg", [0, 10, 20, 30, 60, 90, 135, 179, 180, 181, 250])
def test_two_exchanging_places_keep_distance_and_arrive(angle_deg: int) -> None:
    reach = 10.0
    angle = math.radians(angle_deg)
    goals = [(reach, 0.0), (reach * math.cos(angle), reach * math.sin(angle))]
    places = [[-goals[0][0], -goals[0][1]], [-goals[1][0], -goals[1][1]]]
    if math.dist(places[0], places[1]) < CONFIG.air.separation_m:
        places[1][1] += 2.5
        goals[1] = (goals[1][0], goals[1][1] - 2.5)
    velocities = [[0.0, 0.0], [0.0, 0.0]]
    heights = [8.0, 8.0]
    pilots = [AirController(CONFIG), AirController(CONFIG)]
    least = math.inf
    dt = 0.05
    for step in range(800):
        poses = [
            Pose.planar(p[0], p[1], z, 0.0, (v[0], v[1], 0.0))
            for p, v, z in zip(places, velocities, heights, strict=True)
        ]
        for i, pilot in enumerate(pilots):
            other = poses[1 - i]
            seen = MovingObstacle(other.x_m, other.y_m, other.z_m, other.vx_m_s, other.vy_m_s, 0.0, i == 0)
            place_of = Target(*goals[i], 8.0, None, 3.0, goals[i])
            setpoint = pilot.steer(poses[i], place_of, Surroundings((), (seen,)), (step + 1) * 50_000_000)
            share = 1 - math.exp(-dt / 0.35)
            velocities[i][0] += (setpoint.vx_m_s - velocities[i][0]) * share
            velocities[i][1] += (setpoint.vy_m_s - velocities[i][1]) * share
            places[i][0] += velocities[i][0] * dt
            places[i][1] += velocities[i][1] * dt
            heights[i] += setpoint.vz_m_s * dt
        gap = math.dist((*places[0], heights[0]), (*places[1], heights[1]))
        least = min(least, gap)
    assert least > 0.8
    for place, goal in zip(places, goals, strict=True):
        assert math.dist(place, goal) < 0.3
