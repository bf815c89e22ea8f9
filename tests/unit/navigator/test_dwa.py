"""The dynamic window planner: equations 4 and 5 as a table, and the resulting motion."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.navigator.dwa_arrays import ArrayPlanner

from swarmd.navigator.config import DwaConfig
from swarmd.navigator.core.dwa import Planner, objective, safe_speed, window
from swarmd.navigator.core.target import MovingObstacle, Surroundings
from swarmware.types.vehicle import Pose

LIMITS = DwaConfig()
AHEAD = (100.0, 0.0)


@pytest.mark.parametrize(
    ("distance", "deceleration", "expected"),
    [
        (0.0, 2.0, 0.0),
        (-1.0, 2.0, 0.0),
        (1.0, 2.0, 2.0),
        (4.0, 2.0, 4.0),
        (1.0, 0.5, 1.0),
        (math.inf, 2.0, math.inf),
        (math.pi / 2, 1.0, math.sqrt(math.pi)),
    ],
)
def test_equation_4_safe_speed(distance: float, deceleration: float, expected: float) -> None:
    assert safe_speed(distance, deceleration) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("v", "w", "expected"),
    [
        # a_max 1.8 and α_max 2.5 over 0.2 s: ± 0.36 m/s and ± 0.5 rad/s around the present speeds
        (1.0, 0.0, (0.64, 1.36, -0.5, 0.5)),
        (0.0, 0.0, (-0.3, 0.36, -0.5, 0.5)),
        (2.9, 1.2, (2.54, 3.0, 0.7, 1.4)),
        (9.0, -9.0, (2.64, 3.0, -1.4, -0.9)),
    ],
)
def test_equation_4_window(v: float, w: float, expected: tuple[float, float, float, float]) -> None:
    found = window(LIMITS, v, w)
    assert msgspec.structs.astuple(found) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("weights", "terms", "expected"),
    [
        ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 3.0),
        ((2.0, 0.0, 0.0), (0.5, 1.0, 1.0), 1.0),
        ((0.0, 3.0, 0.0), (1.0, 0.5, 1.0), 1.5),
        ((0.0, 0.0, 4.0), (1.0, 1.0, 0.25), 1.0),
        ((0.8, 0.1, 0.1), (0.5, 1.0, 0.0), 0.5),
    ],
)
def test_equation_5_cost(
    weights: tuple[float, float, float], terms: tuple[float, float, float], expected: float
) -> None:
    limits = DwaConfig(heading_weight=weights[0], distance_weight=weights[1], velocity_weight=weights[2])
    assert objective(limits, *terms) == pytest.approx(expected)


def moving(v: float, w: float = 0.0) -> Pose:
    return Pose.planar(0.0, 0.0, 0.0, 0.0, (v, 0.0, 0.0), w)


def test_free_way_is_driven_straight_at_wanted_speed() -> None:
    choice = Planner(LIMITS).plan(moving(1.0), 1.0, AHEAD, 1.2, Surroundings())
    assert choice.v_m_s == pytest.approx(1.2)
    assert choice.w_rad_s == pytest.approx(0.0)
    assert choice.free


@pytest.mark.parametrize(("ahead", "sign"), [((3.0, 3.0), 1), ((3.0, -3.0), -1), ((-3.0, 0.1), 1)])
def test_it_turns_towards_the_point(ahead: tuple[float, float], sign: int) -> None:
    choice = Planner(LIMITS).plan(moving(1.0), 1.0, ahead, 1.0, Surroundings())
    assert choice.w_rad_s * sign > 0.2


def drive(
    around: Surroundings, seconds: float = 12.0, ahead: tuple[float, float] = (12.0, 0.0)
) -> list[Pose]:
    """The planner in the loop with an exact vehicle."""
    planner, dt = Planner(LIMITS), 0.1
    x = y = yaw = v = w = 0.0
    track = []
    for _ in range(round(seconds / dt)):
        pose = Pose.planar(x, y, 0.0, yaw, (v * math.cos(yaw), v * math.sin(yaw), 0.0), w)
        track.append(pose)
        choice = planner.plan(pose, v, ahead, 1.5, around)
        v = min(max(choice.v_m_s, v - 0.18), v + 0.18)
        w = min(max(choice.w_rad_s, w - 0.25), w + 0.25)
        x, y, yaw = x + v * math.cos(yaw) * dt, y + v * math.sin(yaw) * dt, yaw + w * dt
    return track


def test_it_drives_around_a_boulder_on_its_way() -> None:
    boulder = tuple((6.0 + 0.4 * math.cos(a), 0.05 + 0.4 * math.sin(a)) for a in np.linspace(0, 6.2, 24))
    track = drive(Surroundings(boulder))
    assert min(math.dist((p.x_m, p.y_m), point) for p in track for point in boulder) > LIMITS.radius_m
    assert track[-1].x_m > 9.0
    assert abs(track[-1].y_m) < 0.8


def test_a_late_vehicle_keeps_more_distance() -> None:
    boulder = tuple((6.0 + 0.4 * math.cos(a), 0.05 + 0.4 * math.sin(a)) for a in np.linspace(0, 6.2, 24))
    gaps_m = []
    for delay_s in (0.0, 0.4):
        track = drive(Surroundings(boulder, delay_s=delay_s))
        gaps_m.append(min(math.dist((p.x_m, p.y_m), point) for p in track for point in boulder))
        assert track[-1].x_m > 9.0
    assert gaps_m[1] > gaps_m[0] + 0.02


def test_vehicle_stops_before_unpassable_wall() -> None:
    wall = tuple((6.0, y / 4) for y in range(-40, 41))
    track = drive(Surroundings(wall))
    assert max(p.x_m for p in track) < 6.0 - LIMITS.radius_m


def test_it_gives_way_to_one_that_crosses() -> None:
    planner, dt = Planner(LIMITS), 0.1
    x = y = yaw = w = 0.0
    v = 1.5
    gaps = []
    for step in range(80):
        other = MovingObstacle(6.0, -6.0 + 1.5 * step * dt, 0.0, 0.0, 1.5, 0.0)
        gaps.append(math.hypot(other.x_m - x, other.y_m - y))
        pose = Pose.planar(x, y, 0.0, yaw, (v * math.cos(yaw), v * math.sin(yaw), 0.0), w)
        choice = planner.plan(pose, v, (30.0, 0.0), 1.5, Surroundings((), (other,)))
        v = min(max(choice.v_m_s, v - 0.18), v + 0.18)
        w = min(max(choice.w_rad_s, w - 0.25), w + 0.25)
        x, y, yaw = x + v * math.cos(yaw) * dt, y + v * math.sin(yaw) * dt, yaw + w * dt
    assert min(gaps) > 0.75


def test_what_flies_above_is_no_obstacle() -> None:
    above = Surroundings((), (MovingObstacle(2.0, 0.0, 8.0, 0.0, 0.0, 0.0),))
    choice = Planner(LIMITS).plan(moving(1.5), 1.5, AHEAD, 1.5, above)
    assert (choice.v_m_s, choice.w_rad_s) == pytest.approx((1.5, 0.0))


def test_walled_in_it_stands_and_says_so() -> None:
    ring = tuple((0.4 * math.cos(a), 0.4 * math.sin(a)) for a in np.linspace(0, 6.28, 60))
    choice = Planner(LIMITS).plan(moving(0.0), 0.0, AHEAD, 1.0, Surroundings(ring))
    assert not choice.free
    assert abs(choice.v_m_s) < 0.05


def test_vehicle_too_close_may_drive_away() -> None:
    behind = Surroundings(((-0.45, 0.0),))
    choice = Planner(LIMITS).plan(moving(0.0), 0.0, AHEAD, 1.0, behind)
    assert choice.free
    assert choice.v_m_s > 0.2


def test_in_a_hurry_the_speed_outweighs_the_rest() -> None:
    narrow = tuple((x / 5, side * 0.62) for x in range(4, 20) for side in (-1, 1))
    patient = Planner(LIMITS).plan(moving(0.0), 0.0, AHEAD, 1.0, Surroundings(narrow))
    hasty = Planner(LIMITS).plan(moving(0.0), 0.0, AHEAD, 1.0, Surroundings(narrow), speed_gain=20.0)
    assert hasty.v_m_s >= patient.v_m_s
    assert hasty.v_m_s > 0.2


@given(
    st.floats(0, 3),
    st.floats(-1.4, 1.4),
    st.lists(st.tuples(st.floats(-6, 6), st.floats(-6, 6)), max_size=12),
)
def test_choice_is_always_attainable_and_can_be_braked(
    v: float, w: float, points: list[tuple[float, float]]
) -> None:
    points = [p for p in points if math.hypot(*p) > LIMITS.radius_m]
    choice = Planner(LIMITS).plan(moving(v, w), v, AHEAD, 2.0, Surroundings(tuple(points)))
    if choice.score == -math.inf:
        assert (choice.v_m_s, choice.w_rad_s) == (0.0, 0.0)
        return
    lim = window(LIMITS, v, w)
    assert lim.v_min_m_s - 1e-9 <= choice.v_m_s <= lim.v_max_m_s + 1e-9
    assert lim.w_min_rad_s - 1e-9 <= choice.w_rad_s <= lim.w_max_rad_s + 1e-9
    # follow the chosen arc in small steps: before any contact there is room to brake
    x = y = yaw = way = 0.0
    dt = 0.005
    for _ in range(round(LIMITS.horizon_s / dt)):
        x += choice.v_m_s * math.cos(yaw) * dt
        y += choice.v_m_s * math.sin(yaw) * dt
        yaw += choice.w_rad_s * dt
        way += abs(choice.v_m_s) * dt
        if points and min(math.dist((x, y), p) for p in points) < LIMITS.radius_m / 2:
            assert choice.v_m_s**2 <= 2 * (way + 0.05) * LIMITS.a_max_m_s2 + 1e-6
            break


NEAR = st.floats(-4.0, 4.0)
SPEED = st.floats(-0.3, 3.0)
POINT = st.tuples(NEAR, NEAR)
MOVERS = st.builds(
    MovingObstacle, NEAR, NEAR, st.just(0.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.just(0.0)
)


@given(
    at=st.tuples(NEAR, NEAR, st.floats(-3.1, 3.1)),
    speed=st.tuples(SPEED, st.floats(-1.4, 1.4)),
    ahead=POINT,
    wanted=SPEED,
    around=st.builds(
        Surroundings, st.lists(POINT, max_size=12).map(tuple), st.lists(MOVERS, max_size=4).map(tuple)
    ),
    gain=st.floats(1.0, 20.0),
)
def test_choice_equals_exhaustive_candidate_search(
    at: tuple[float, float, float],
    speed: tuple[float, float],
    ahead: tuple[float, float],
    wanted: float,
    around: Surroundings,
    gain: float,
) -> None:
    pose = Pose.planar(at[0], at[1], 0.0, at[2], (0.0, 0.0, 0.0), speed[1])
    found = Planner(LIMITS).plan(pose, speed[0], ahead, wanted, around, gain)
    best = ArrayPlanner(LIMITS).plan(pose, speed[0], ahead, wanted, around, gain)
    assert found.free == best.free
    assert found.score == pytest.approx(best.score, abs=1e-9)
