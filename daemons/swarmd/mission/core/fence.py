"""Geofence: where a vehicle is to its limits, whether it can still stop before them, targets outside."""

import math
from collections.abc import Iterator
from typing import Final

import msgspec

from swarmd.mission.fence_config import FenceConfig
from swarmware.errors import InvalidInput
from swarmware.geometry.geodesy import LocalMap
from swarmware.geometry.polygon import Point, contains, crosses, distance_to_boundary
from swarmware.mission.catalogue import Formation, Goto, Takeoff, Waypoints
from swarmware.mission.model import MissionDefinition
from swarmware.types.fence import FenceLimit, FenceState
from swarmware.types.vehicle import Pose

REACTION_S: Final = 0.8
"""Time from a position to the brakes: the fence is evaluated five times a second, reactions four times, and a
busy computer is later. Measured from the first value with `leaving`: 0.2 to 0.4 s."""
BRAKE_M_S2: Final = 2.0
"""Deceleration of a hold. Measured in the simulation, with the reaction: 2.5 m from 3 m/s, 6.3 to 7.4 m from
5 m/s."""


class Area(msgspec.Struct, frozen=True):
    """Horizontal limit in the map: a polygon, or a circle."""

    corners: tuple[Point, ...] = ()
    centre: Point = (0.0, 0.0)
    radius_m: float = 0.0

    def distance_m(self, place: Point) -> float:
        """Distance to the boundary, positive inside."""
        if not self.corners:
            return self.radius_m - math.dist(self.centre, place)
        away_m = distance_to_boundary(self.corners, place)
        return away_m if contains(self.corners, place) else -away_m

    def left_on(self, start: Point, end: Point) -> bool:
        """Whether a straight way from a place inside meets the boundary."""
        if not self.corners:
            return self.distance_m(end) <= 0.0
        return crosses(self.corners, start, end)


def area_of(config: FenceConfig, local_map: LocalMap | None) -> Area | None:
    """The horizontal limit in the map, or None if the fence limits only heights.

    `local_map`: required for a fence in degrees.
    Raises: InvalidInput for a fence in degrees without `local_map`.
    """

    def place(point: Point) -> Point:
        if local_map is None:
            raise InvalidInput("fence in degrees: expected the origin of the map")
        x_m, y_m, _ = local_map.to_local(point[0], point[1], 0.0)
        return x_m, y_m

    if config.polygon_m:
        return Area(corners=config.polygon_m)
    if config.polygon_deg:
        return Area(corners=tuple(place(corner) for corner in config.polygon_deg))
    if config.radius_m is None:
        return None
    centre = config.centre_m if config.centre_m is not None else place(config.centre_deg or (0.0, 0.0))
    return Area(centre=centre, radius_m=config.radius_m)


def needs_origin(config: FenceConfig) -> bool:
    """Whether the fence is in degrees."""
    return bool(config.polygon_deg) or config.centre_deg is not None


def stop_m(speed_m_s: float) -> float:
    """Distance within which a vehicle of this speed stands after the order to hold."""
    return speed_m_s * REACTION_S + speed_m_s * speed_m_s / (2 * BRAKE_M_S2)


class Geofence:
    """The limits of one vehicle in its map."""

    def __init__(self, config: FenceConfig, area: Area | None) -> None:
        self._config = config
        self._area = area
        self._risen = False
        """Whether the vehicle rose above the lowest height since its take-off; only then is that a limit."""

    def _heights(self, z_m: float, *, bound_below: bool) -> list[tuple[float, FenceLimit]]:
        """Distance to each limit of the height, positive inside."""
        low, high, found = self._config.min_height_m, self._config.max_height_m, []
        if low is not None and bound_below:
            found.append((z_m - low, FenceLimit.MIN_HEIGHT))
        if high is not None:
            found.append((high - z_m, FenceLimit.MAX_HEIGHT))
        return found

    def state(self, pose: Pose, *, landed: bool, landing: bool) -> FenceState:
        """Where a vehicle is, and whether it is about to leave.

        The lowest height binds from the climb above it until a landing is ordered.
        """
        config = self._config
        bound_below = self._bound_below(pose.z_m, free=landed or landing)
        distances = self._heights(pose.z_m, bound_below=bound_below)
        if self._area is not None:
            distances.append((self._area.distance_m((pose.x_m, pose.y_m)), FenceLimit.AREA))
        distance_m, limit = min(distances, key=lambda one: one[0], default=(math.inf, FenceLimit.NONE))
        inside = distance_m >= 0.0
        return FenceState(
            True,
            inside,
            not inside or distance_m < config.margin_m or self._runs_out(pose, bound_below=bound_below),
            distance_m if math.isfinite(distance_m) else None,
            limit,
            config.min_height_m,
            config.max_height_m,
        )

    def _bound_below(self, z_m: float, *, free: bool) -> bool:
        low = self._config.min_height_m
        if free or low is None:
            self._risen = False
        elif z_m >= low + self._config.margin_m:  # within the margin it would be reported as leaving
            self._risen = True
        return self._risen

    def _runs_out(self, pose: Pose, *, bound_below: bool) -> bool:
        """Whether the vehicle would stop beyond a limit or within its margin, if a hold were ordered now."""
        speed_m_s = math.hypot(pose.vx_m_s, pose.vy_m_s)
        if self._area is not None and speed_m_s > 0.0:
            ahead_m = stop_m(speed_m_s) + self._config.margin_m
            here = (pose.x_m, pose.y_m)
            there = (
                pose.x_m + pose.vx_m_s / speed_m_s * ahead_m,
                pose.y_m + pose.vy_m_s / speed_m_s * ahead_m,
            )
            # the end alone does not suffice: a concave fence may be left and entered again on the way
            if self._area.left_on(here, there):
                return True
        rise_m = math.copysign(stop_m(abs(pose.vz_m_s)), pose.vz_m_s)
        heights = self._heights(pose.z_m + rise_m, bound_below=bound_below)
        return any(left_m < self._config.margin_m for left_m, _ in heights)

    def why_not(self, place: Point | None, z_m: float | None) -> str:
        """Reason to refuse a target, or "" if it is within all limits.

        `place`: None for a target that is only a height; `z_m`: None for a target that keeps its height.
        """
        distances = [] if z_m is None else self._heights(z_m, bound_below=True)
        if place is not None and self._area is not None:
            distances.append((self._area.distance_m(place), FenceLimit.AREA))
        margin_m = self._config.margin_m
        return ", ".join(
            _text(left_m, limit, self._config) for left_m, limit in distances if left_m < margin_m
        )


def targets(mission: MissionDefinition, platform: str) -> Iterator[tuple[str, Point | None, float | None]]:
    """Targets that a mission names: block, place, and height where it has one."""
    for block in mission.blocks.values():
        name, params = f"{block.type} {block.id}", block.params
        match params:
            case Goto():
                yield name, (params.x_m, params.y_m), params.z_m
            case Waypoints():
                for x_m, y_m, *z_m in params.points_m:
                    yield name, (x_m, y_m), z_m[0] if z_m else None
            case Takeoff():
                yield name, None, params.altitude_m
            case Formation() if params.leader == platform:
                for x_m, y_m, *_ in params.course:
                    yield name, (x_m, y_m), None


_WORDS: Final = {
    FenceLimit.AREA: "the boundary",
    FenceLimit.MIN_HEIGHT: "the lowest height",
    FenceLimit.MAX_HEIGHT: "the greatest height",
}


def _text(left_m: float, limit: FenceLimit, config: FenceConfig) -> str:
    limits = {FenceLimit.MIN_HEIGHT: config.min_height_m, FenceLimit.MAX_HEIGHT: config.max_height_m}
    words, height_m = _WORDS[limit], limits.get(limit)
    named = words if height_m is None else f"{words} ({height_m:g} m)"
    if left_m < 0.0:
        return f"{-left_m:.1f} m outside {named} of the fence"
    return f"{left_m:.1f} m from {named} of the fence; expected {config.margin_m:g} m (margin_m)"
