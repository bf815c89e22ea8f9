"""Plane polygons: whether a point is inside, the distance to the boundary, crossings of edges."""

import math
from collections.abc import Iterator, Sequence

Point = tuple[float, float]
"""Place in a plane."""


def edges(polygon: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    """The edges of a polygon in order; the last one returns to the first point."""
    for index, end in enumerate(polygon):
        yield polygon[index - 1], end


def contains(polygon: Sequence[Point], point: Point) -> bool:
    """Whether a point is inside, by the number of edges that a ray towards +x crosses.

    A point exactly on an edge may count as either; its distance to the boundary is zero.
    """
    x, y = point
    inside = False
    for (x1, y1), (x2, y2) in edges(polygon):
        if (y1 > y) is not (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            inside = not inside
    return inside


def distance_to_boundary(polygon: Sequence[Point], point: Point) -> float:
    """Distance from a point to the nearest edge, on either side of it."""
    return min(distance_to_segment(start, end, point) for start, end in edges(polygon))


def distance_to_segment(start: Point, end: Point, point: Point) -> float:
    """Distance from a point to a line segment."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    px, py = point[0] - start[0], point[1] - start[1]
    length2 = dx * dx + dy * dy
    along = 0.0 if length2 == 0.0 else min(max((px * dx + py * dy) / length2, 0.0), 1.0)
    return math.hypot(px - along * dx, py - along * dy)


def _side(a: Point, b: Point, c: Point) -> float:
    """Positive if c is left of the line from a to b, negative if right of it, 0 on it."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def segments_meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether two line segments have a point in common, also an end."""
    ab_c, ab_d, cd_a, cd_b = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
    if (
        ((ab_c > 0) is not (ab_d > 0))
        and ((cd_a > 0) is not (cd_b > 0))
        and 0.0 not in (ab_c, ab_d, cd_a, cd_b)
    ):
        return True
    return any(
        side == 0.0 and distance_to_segment(start, end, point) == 0.0
        for side, start, end, point in ((ab_c, a, b, c), (ab_d, a, b, d), (cd_a, c, d, a), (cd_b, c, d, b))
    )


def crosses(polygon: Sequence[Point], start: Point, end: Point) -> bool:
    """Whether a straight way meets the boundary."""
    return any(segments_meet(start, end, first, second) for first, second in edges(polygon))


def self_intersection(polygon: Sequence[Point]) -> tuple[int, int] | None:
    """Numbers of the first two edges that meet beside their common point, or None for a simple polygon.

    Edge n, from 0, starts at point n; an edge without length is named twice.
    """
    count = len(polygon)
    for first in range(count):
        if polygon[first] == polygon[(first + 1) % count]:
            return first, first
    for first in range(count):
        a, b = polygon[first], polygon[(first + 1) % count]
        for second in range(first + 1, count):
            c, d = polygon[second], polygon[(second + 1) % count]
            if second == first + 1:  # a spike turns back on its own edge
                meet = distance_to_segment(a, b, d) == 0.0 or distance_to_segment(c, d, a) == 0.0
            elif first == 0 and second == count - 1:
                meet = distance_to_segment(a, b, c) == 0.0 or distance_to_segment(c, d, b) == 0.0
            else:
                meet = segments_meet(a, b, c, d)
            if meet:
                return first, second
    return None
