"""The course: waypoints joined by straight lines and arcs, measured by distance along it."""

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Final

import msgspec

from swarmware.errors import InvalidInput

TURN_RADIUS_M: Final = 30.0
"""Radius of the arc at a waypoint, where the legs are long enough: twice the half width of a wedge of ten."""

WINDOW_M: Final = 10.0
"""Maximum distance along the course between two projections: a course may approach itself."""

_SHARP_M: Final = 0.1
"""An arc with a smaller radius than this is a corner."""


class PathPoint(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A point of the course."""

    x_m: float
    y_m: float
    heading_rad: float
    """Direction of the course here, 0 is east, counter-clockwise."""
    curvature_1_m: float
    """Positive: the course bends to the left."""


class _Segment(msgspec.Struct, frozen=True, gc=False):
    start_m: float
    """Distance along the course at which it begins."""
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    curvature_1_m: float

    def at(self, distance_m: float) -> PathPoint:
        """The point this far from the segment's beginning, also beyond its ends."""
        k = self.curvature_1_m
        h = self.heading_rad
        if k == 0.0:
            return PathPoint(self.x_m + distance_m * math.cos(h), self.y_m + distance_m * math.sin(h), h, 0.0)
        end = h + k * distance_m
        return PathPoint(
            self.x_m + (math.sin(end) - math.sin(h)) / k,
            self.y_m - (math.cos(end) - math.cos(h)) / k,
            end,
            k,
        )

    def nearest(self, x_m: float, y_m: float, low_m: float, high_m: float) -> float:
        """Distance from the segment's beginning to its point nearest to x, y, between two limits."""
        k = self.curvature_1_m
        h = self.heading_rad
        if k == 0.0:
            along = (x_m - self.x_m) * math.cos(h) + (y_m - self.y_m) * math.sin(h)
            return min(max(along, low_m), high_m)
        centre_x = self.x_m - math.sin(h) / k
        centre_y = self.y_m + math.cos(h) / k
        side = math.copysign(1.0, k)
        begin = math.atan2(side * -math.cos(h), side * math.sin(h))
        here = math.atan2(y_m - centre_y, x_m - centre_x)
        # nearest turn of the angle to the middle of the arc: beyond the ends both sides are possible
        middle = k * (low_m + high_m) / 2
        turned = math.remainder(here - begin - middle, math.tau) + middle
        return min(max(turned / k, low_m), high_m)


class Course:
    """Smooth path along waypoints, with the distance along it as coordinate.

    It is extended straight beyond both ends, so that slots behind the leader
    exist from the first moment.
    Raises: InvalidInput for less than two different waypoints.
    """

    __slots__ = ("_segments", "_starts", "length_m", "points")

    def __init__(self, points: tuple[tuple[float, float], ...], turn_radius_m: float = TURN_RADIUS_M) -> None:
        kept = _different(points)
        if len(kept) < 2:
            raise InvalidInput(f"course {list(points)}: expected at least two different waypoints")
        self.points = tuple(kept)
        self._segments = _build(kept, turn_radius_m)
        self._starts = [segment.start_m for segment in self._segments]
        last = self._segments[-1]
        self.length_m = last.start_m + last.length_m

    def at(self, s_m: float) -> PathPoint:
        """The point at a distance along the course, which extends straight beyond both ends."""
        # before the first start the first segment, which is straight and extends backwards
        segment = self._segments[max(0, bisect_right(self._starts, s_m) - 1)]
        return segment.at(s_m - segment.start_m)

    def project(self, x_m: float, y_m: float, near_m: float | None = None) -> float:
        """Distance along the course of its point nearest to x, y.

        With `near_m` only points within WINDOW_M of it count; without, the first of equally near ones.
        """
        best_s = 0.0
        best = math.inf
        last = len(self._segments) - 1
        for index, segment in enumerate(self._segments):
            # only the ends extend straight on; inside, a segment ends where the next one begins
            low = -math.inf if index == 0 else 0.0
            high = math.inf if index == last else segment.length_m
            if near_m is not None:
                low = max(low, near_m - WINDOW_M - segment.start_m)
                high = min(high, near_m + WINDOW_M - segment.start_m)
                if low > high:
                    continue
            along = segment.nearest(x_m, y_m, low, high)
            point = segment.at(along)
            distance = math.hypot(point.x_m - x_m, point.y_m - y_m)
            # the margin keeps the first of equally near points in spite of rounding
            if distance < best - 1e-9:
                best, best_s = distance, segment.start_m + along
        return best_s


def _different(points: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    kept: list[tuple[float, float]] = []
    for x, y in points:
        if not kept or math.dist(kept[-1], (x, y)) > 1e-6:
            kept.append((float(x), float(y)))
    return kept


def _build(points: list[tuple[float, float]], turn_radius_m: float) -> list[_Segment]:
    legs = [math.dist(a, b) for a, b in pairwise(points)]
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(points)]
    segments: list[_Segment] = []
    s = 0.0
    cut_before = 0.0
    for i, (leg, heading) in enumerate(zip(legs, headings, strict=True)):
        cut_after = 0.0
        turn = radius = 0.0
        if i + 1 < len(legs):
            turn = math.remainder(headings[i + 1] - heading, math.tau)
            # a leg between two turns is shared by their arcs
            room = min(leg if i == 0 else leg / 2, legs[i + 1] if i + 2 == len(legs) else legs[i + 1] / 2)
            # the arc touches both legs at this multiple of its radius from the waypoint
            slope = math.tan(abs(turn) / 2)
            radius = min(turn_radius_m, room / slope) if slope > 1e-9 else 0.0
            if radius < _SHARP_M:
                radius = 0.0
            cut_after = radius * slope
        straight = leg - cut_before - cut_after
        x = points[i][0] + cut_before * math.cos(heading)
        y = points[i][1] + cut_before * math.sin(heading)
        first_or_last = i in {0, len(legs) - 1}
        # the ends stay, even if short: the course extends along them
        if straight > 1e-9 or first_or_last:
            segments.append(_Segment(s, max(0.0, straight), x, y, heading, 0.0))
            s += max(0.0, straight)
        if radius > 0.0:
            arc = _Segment(
                s,
                radius * abs(turn),
                points[i + 1][0] - cut_after * math.cos(heading),
                points[i + 1][1] - cut_after * math.sin(heading),
                heading,
                math.copysign(1 / radius, turn),
            )
            segments.append(arc)
            s += arc.length_m
        cut_before = cut_after
    return segments
