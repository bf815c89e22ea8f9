"""Plane polygons: inside and outside, edges and corners, concave shapes, crossings."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.geometry.polygon import (
    Point,
    contains,
    crosses,
    distance_to_boundary,
    segments_meet,
    self_intersection,
)

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
BAY = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 2.0), (0.0, 10.0))
"""Concave: a bay that is open to the north."""


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    ("polygon", "point", "inside", "distance"),
    [
        (SQUARE, (5.0, 5.0), True, 5.0),
        (SQUARE, (9.0, 5.0), True, 1.0),
        (SQUARE, (11.0, 5.0), False, 1.0),
        (SQUARE, (13.0, 14.0), False, 5.0),
        (SQUARE, (-1.0, 0.0), False, 1.0),
        (SQUARE, (-5.0, 10.0), False, 5.0),
        (BAY, (5.0, 1.0), True, 1.0),
        (BAY, (5.0, 9.0), False, 7 * 5 / math.hypot(5, 8)),
        (BAY, (1.0, 5.0), True, 1.0),
    ],
)
def test_place_is_inside_or_outside_by_its_distance(
    polygon: tuple[Point, ...], point: Point, inside: bool, distance: float, turn: int
) -> None:
    corners = polygon[::turn]
    assert contains(corners, point) is inside
    assert distance_to_boundary(corners, point) == pytest.approx(distance)


@pytest.mark.parametrize("point", [(0.0, 0.0), (10.0, 10.0), (5.0, 0.0), (10.0, 3.0), (0.0, 7.0)])
def test_a_point_on_an_edge_has_no_distance(point: Point) -> None:
    assert distance_to_boundary(SQUARE, point) == 0.0


@pytest.mark.parametrize(
    ("a", "b", "c", "d", "meet"),
    [
        ((0, 0), (2, 2), (0, 2), (2, 0), True),
        ((0, 0), (1, 1), (0, 2), (2, 1), False),
        ((0, 0), (2, 0), (1, 0), (1, 5), True),  # touches
        ((0, 0), (2, 0), (1, 1), (1, 5), False),
        ((0, 0), (2, 0), (1, 0), (3, 0), True),  # on one line
        ((0, 0), (1, 0), (2, 0), (3, 0), False),
        ((0, 0), (0, 0), (0, 0), (3, 0), True),
    ],
)
def test_segments_meet_also_at_their_ends(a: Point, b: Point, c: Point, d: Point, meet: bool) -> None:
    assert segments_meet(a, b, c, d) is meet
    assert segments_meet(d, c, b, a) is meet


def test_way_that_leaves_and_returns_crosses_bay() -> None:
    assert crosses(BAY, (1.0, 7.0), (9.0, 7.0)), "both ends are inside"
    assert not crosses(BAY, (1.0, 1.0), (9.0, 1.0))
    assert crosses(BAY, (5.0, 1.0), (5.0, -4.0))


@pytest.mark.parametrize(
    ("corners", "found"),
    [
        (SQUARE, None),
        (BAY, None),
        (((0, 0), (10, 10), (10, 0), (0, 10)), (0, 2)),  # a bow tie
        (((0, 0), (10, 0), (10, 0), (0, 10)), (1, 1)),  # a corner twice
        (((0, 0), (10, 0), (5, 0), (5, 5)), (0, 1)),  # a spike
        (((0, 0), (10, 0), (10, 10), (5, 0), (0, 10)), (0, 2)),  # a corner on another edge
        (((0, 0), (5, 5), (10, 0), (5, 5), (5, 9)), (0, 2)),
        (((0, 0), (5, 0), (9, 0)), (0, 2)),  # no area
    ],
)
def test_a_boundary_that_meets_itself_is_found(
    corners: tuple[Point, ...], found: tuple[int, int] | None
) -> None:
    assert self_intersection(corners) == found


coordinates = st.floats(-1e4, 1e4, allow_nan=False)


@given(
    st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=8), st.tuples(coordinates, coordinates)
)
def test_any_polygon_has_an_answer(corners: list[Point], point: Point) -> None:
    assert contains(corners, point) in {True, False}
    assert distance_to_boundary(corners, point) >= 0.0
    found = self_intersection(corners)
    assert found is None or found[0] <= found[1] < len(corners)


@given(st.floats(0.0, 2 * math.pi), st.floats(0.0, 30.0))
def test_a_regular_polygon_agrees_with_its_circles(angle: float, radius: float) -> None:
    corners = [(10 * math.cos(i * math.pi / 6), 10 * math.sin(i * math.pi / 6)) for i in range(12)]
    inner = 10 * math.cos(math.pi / 12)
    point = (radius * math.cos(angle), radius * math.sin(angle))
    if radius < inner - 1e-6:
        assert contains(corners, point)
        assert distance_to_boundary(corners, point) >= inner - radius - 1e-6
    elif radius > 10 + 1e-6:
        assert not contains(corners, point)
        assert distance_to_boundary(corners, point) >= radius - 10 - 1e-6
