"""Course: arcs between legs, distance along it, projection onto it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput
from swarmware.geometry.course import TURN_RADIUS_M, WINDOW_M, Course

COURSE = ((0.0, 0.0), (32.0, 0.0), (62.0, 20.0), (95.0, 20.0))


def test_a_straight_course_is_measured_in_metres() -> None:
    course = Course(((1.0, 2.0), (1.0, 12.0)))
    assert course.length_m == pytest.approx(10.0)
    point = course.at(4.0)
    assert (point.x_m, point.y_m, point.heading_rad) == pytest.approx((1.0, 6.0, math.pi / 2))
    assert point.curvature_1_m == 0.0


def test_course_continues_straight_beyond_both_ends() -> None:
    course = Course(((0.0, 0.0), (10.0, 0.0)))
    assert (course.at(-5.0).x_m, course.at(15.0).x_m) == pytest.approx((-5.0, 15.0))
    assert course.project(-7.0, 3.0) == pytest.approx(-7.0)
    assert course.project(17.0, 3.0) == pytest.approx(17.0)


def test_turn_is_arc_of_wanted_radius() -> None:
    course = Course(COURSE)
    curvatures = {round(course.at(s / 4).curvature_1_m, 6) for s in range(400)}
    assert curvatures == {0.0, round(1 / TURN_RADIUS_M, 6), round(-1 / TURN_RADIUS_M, 6)}


@given(
    st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=6),
)
def test_the_position_never_jumps(
    points: list[tuple[float, float]],
) -> None:
    try:
        course = Course(tuple(points))
    except InvalidInput:
        return
    step = 0.05
    for i in range(min(4000, int(course.length_m / step))):
        a, b = course.at(i * step), course.at((i + 1) * step)
        assert math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) <= step + 1e-6
    assert math.dist((course.at(0).x_m, course.at(0).y_m), course.points[0]) < 1e-6
    end = course.at(course.length_m)
    assert math.dist((end.x_m, end.y_m), course.points[-1]) < 1e-6


@given(st.floats(-20, 120), st.floats(-12, 12))
def test_point_beside_course_projects_onto_its_foot(s: float, aside: float) -> None:
    course = Course(COURSE)
    point = course.at(s)
    x = point.x_m - aside * math.sin(point.heading_rad)
    y = point.y_m + aside * math.cos(point.heading_rad)
    assert course.project(x, y, s) == pytest.approx(s, abs=1e-6)


def test_self_crossing_course_is_followed_from_place() -> None:
    loop = Course(((0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (50.0, 80.0), (50.0, -50.0)), turn_radius_m=5.0)
    assert loop.project(50.0, 0.0) == pytest.approx(50.0)
    later = loop.length_m - 50.0
    assert loop.project(50.0, 0.0, later + 3.0) == pytest.approx(later)


def test_a_projection_stays_within_its_window() -> None:
    course = Course(COURSE)
    assert course.project(90.0, 20.0, 10.0) == pytest.approx(10.0 + WINDOW_M)


@pytest.mark.parametrize("points", [(), ((1.0, 1.0),), ((1.0, 1.0), (1.0, 1.0))])
def test_a_course_needs_two_waypoints(points: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(InvalidInput, match="expected at least two different waypoints"):
        Course(points)


def test_way_back_on_itself_is_corner_not_arc() -> None:
    course = Course(((0.0, 0.0), (10.0, 0.0), (0.0, 0.0)))
    assert course.length_m == pytest.approx(20.0)
    assert course.at(15.0).x_m == pytest.approx(5.0)
