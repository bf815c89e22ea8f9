"""The route around seen obstacles: the shortest, through gaps of sufficient width, or none."""

import math

import pytest

from swarmd.navigator.core.route import CELL_M, CELLS_LIMIT, REACH_M, STEPS, Point, RouteSearch, SeenObstacles

WALL = [(5.0, y / 4) for y in range(-24, 25)]
WIDTH_M = 0.6


def routed(points: list[Point], goal: Point) -> tuple[list[Point] | None, int]:
    """The route from the origin, and the number of steps of its search."""
    seen = SeenObstacles()
    seen.add(points)
    search = RouteSearch((0.0, 0.0), goal, seen.occupied(WIDTH_M))
    steps = 0
    route = None
    while not search.done:
        route = search.advance()
        steps += 1
    return route, steps


def clearance_m(route: list[Point], points: list[Point]) -> float:
    legs = zip([(0.0, 0.0), *route], route, strict=False)
    along = [
        (x0 + (x1 - x0) * n / 50, y0 + (y1 - y0) * n / 50) for (x0, y0), (x1, y1) in legs for n in range(51)
    ]
    return min(math.dist(here, point) for here in along for point in points)


def test_it_leads_around_the_end_of_a_wall() -> None:
    route, _ = routed(WALL, (10.0, 0.0))
    assert route is not None
    assert route[-1] == (10.0, 0.0)
    assert max(abs(y) for _, y in route) < 9.0
    assert clearance_m(route, WALL) >= WIDTH_M - CELL_M


@pytest.mark.parametrize(("gap_m", "through"), [(3.0, True), (0.8, False)])
def test_detour_uses_gap_only_for_fitting_vehicle(gap_m: float, through: bool) -> None:
    points = [point for point in WALL if abs(point[1]) > gap_m / 2]
    route, _ = routed(points, (10.0, 0.0))
    assert route is not None
    assert (max(abs(y) for _, y in route) < 2.0) == through


def test_without_obstacles_it_is_the_straight_line() -> None:
    assert routed([], (10.0, 0.0)) == ([(10.0, 0.0)], 1)


def test_enclosed_vehicle_has_no_route_and_ends() -> None:
    ring = [(3 * math.cos(angle / 20), 3 * math.sin(angle / 20)) for angle in range(126)]
    route, steps = routed(ring, (10.0, 0.0))
    assert route is None
    assert steps < 10


def test_far_goal_is_aimed_at_within_reach() -> None:
    route, _ = routed(WALL, (1_000.0, 0.0))
    assert route is not None
    assert route[-1] == (REACH_M, 0.0)


def test_search_without_way_takes_few_cells() -> None:
    box = [(x / 2, y) for x in range(-60, 100) for y in (-16.0, 16.0)]
    box += [(x, y / 2) for x in (-16.0, 26.0) for y in range(-32, 33)]
    goal = (10.0, 0.0)
    around_goal = [(10 + math.cos(a / 5), math.sin(a / 5)) for a in range(32)]
    route, steps = routed(box + around_goal, goal)
    assert route is None
    assert 2 < steps <= math.ceil(85 * 65 / STEPS)


def test_the_oldest_obstacles_are_forgotten_first() -> None:
    seen = SeenObstacles()
    seen.add((float(n), 0.0) for n in range(CELLS_LIMIT + 10))
    assert (0, 0) not in seen.occupied(0.1)
    assert len(seen.occupied(0.1)) == CELLS_LIMIT
    seen.clear()
    assert seen.occupied(1.0) == frozenset()
