"""The world: origin of the map, its obstacles, and the start positions of vehicles."""

import math
from collections.abc import Iterator
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.geometry.formation import Shape, place
from swarmware.geometry.geodesy import Origin
from swarmware.types.vehicle import Pose

Metres = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
Size = Annotated[float, msgspec.Meta(gt=0, le=10_000)]
Span = tuple[Metres, Metres]

_FAR: Final = 1e-12


class Bounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The part of the map that belongs to the world; leaving it is an event."""

    x_m: Span
    y_m: Span
    z_m: Span = (-1.0, 120.0)

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m), ("z_m", self.z_m)):
            if not low < high:
                raise InvalidInput(f"{name}: [{low}, {high}], expected [minimum, maximum]")

    def contains(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Whether a point is inside."""
        return all(
            low <= value <= high for value, (low, high) in ((x_m, self.x_m), (y_m, self.y_m), (z_m, self.z_m))
        )


class Circle(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright cylinder: a tree, a mast, a boulder."""

    name: str
    x_m: Metres
    y_m: Metres
    radius_m: Size
    height_m: Size

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Distance of a point from the outline, seen from above, negative for a point inside."""
        return math.hypot(x_m - self.x_m, y_m - self.y_m) - self.radius_m

    def hit_m(self, x_m: float, y_m: float, dx: float, dy: float) -> float:
        """Length of a ray until it meets the outline, from outside; infinite when it never does."""
        rx, ry = self.x_m - x_m, self.y_m - y_m
        along = rx * dx + ry * dy
        across2 = rx * rx + ry * ry - along * along
        inside2 = self.radius_m * self.radius_m - across2
        # the ray passes the circle, or only touches it
        if inside2 <= 0.0:
            return math.inf
        length = along - math.sqrt(inside2)
        return length if length >= 0.0 else math.inf

    def reach_m(self) -> float:
        """Radius of a circle around its centre that holds it."""
        return self.radius_m


class Box(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright box along the map's axes, or turned by a yaw: a wall, a house."""

    name: str
    x_m: Metres
    y_m: Metres
    """y of the centre of the box."""
    size_m: tuple[Size, Size]
    """Lengths along its own x and y axes."""
    height_m: Size
    yaw_rad: Annotated[float, msgspec.Meta(ge=-6.3, le=6.3)] = 0.0

    def _local(self, x_m: float, y_m: float) -> tuple[float, float]:
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        rx, ry = x_m - self.x_m, y_m - self.y_m
        return rx * cos + ry * sin, ry * cos - rx * sin

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Distance of a point from the outline, seen from above, negative for a point inside."""
        px, py = self._local(x_m, y_m)
        qx, qy = abs(px) - self.size_m[0] / 2, abs(py) - self.size_m[1] / 2
        return math.hypot(max(qx, 0.0), max(qy, 0.0)) + min(max(qx, qy), 0.0)

    def hit_m(self, x_m: float, y_m: float, dx: float, dy: float) -> float:
        """Length of a ray until it meets the outline, from outside; infinite when it never does."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        px, py = self._local(x_m, y_m)
        near, far = -math.inf, math.inf
        for p, d, half in (
            (px, dx * cos + dy * sin, self.size_m[0] / 2),
            (py, dy * cos - dx * sin, self.size_m[1] / 2),
        ):
            # parallel to this pair of sides: inside of them or never; a division would overflow
            if abs(d) < _FAR:
                if abs(p) > half:
                    return math.inf
                continue
            one, two = (-half - p) / d, (half - p) / d
            # slab method: the ray is inside the box where it is between both pairs of sides
            near, far = max(near, min(one, two)), min(far, max(one, two))
        return near if 0.0 <= near <= far else math.inf

    def reach_m(self) -> float:
        """Radius of a circle around its centre that holds it."""
        return math.hypot(*self.size_m) / 2


Obstacle = Circle | Box


class StartRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Start positions of the vehicles of one kind: places in a shape, the first at its head."""

    x_m: Metres
    y_m: Metres
    """y of the head of the shape."""
    yaw_rad: Annotated[float, msgspec.Meta(ge=-6.3, le=6.3)] = 0.0
    shape: Shape = "line"
    spacing_m: Size = 4.0
    jitter_m: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.0
    """Maximum distance of a vehicle from its place, in x and y."""

    def pose(self, number: int, jitter: tuple[float, float] = (0.0, 0.0)) -> Pose:
        """Start of the vehicle with this number, counted from 1; jitter from -1 to 1 in x and y."""
        forward, left = place(self.shape, number - 1, self.spacing_m)
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose.planar(
            self.x_m + forward * cos - left * sin + jitter[0] * self.jitter_m,
            self.y_m + forward * sin + left * cos + jitter[1] * self.jitter_m,
            0.0,
            self.yaw_rad,
        )


class World(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A world file: share/swarm/worlds/<name>.toml."""

    description: str
    origin: Origin = Origin()
    bounds: Bounds
    circles: tuple[Circle, ...] = ()
    boxes: tuple[Box, ...] = ()
    start: dict[str, StartRule] = {}
    """Rule per kind of platform: uav, ugv, usv."""

    def __post_init__(self) -> None:
        seen: set[str] = set()
        for obstacle in self.obstacles():
            # events and findings name an obstacle, so its name must be unique
            if obstacle.name in seen:
                raise InvalidInput(f"obstacle {obstacle.name!r}: the name is used twice, expected once")
            seen.add(obstacle.name)

    def obstacles(self) -> Iterator[Obstacle]:
        """Iterate over all obstacles."""
        yield from self.circles
        yield from self.boxes

    def start_pose(self, kind: str, number: int, jitter: tuple[float, float] = (0.0, 0.0)) -> Pose:
        """Start pose of a vehicle.

        Raises: InvalidInput when the world has no rule for the kind.
        """
        rule = self.start.get(kind)
        if rule is None:
            known = ", ".join(sorted(self.start)) or "none"
            raise InvalidInput(f"start of kind {kind!r}: the world has a rule for {known} only")
        return rule.pose(number, jitter)

    def touching(self, x_m: float, y_m: float, z_m: float, radius_m: float) -> Obstacle | None:
        """The obstacle that a sphere of this radius touches, if any."""
        for obstacle in self.obstacles():
            gap = obstacle.distance_m(x_m, y_m)
            # too far from above already: the height needs no check
            if gap >= radius_m:
                continue
            above = z_m - obstacle.height_m
            if above <= 0.0 or math.hypot(max(gap, 0.0), above) < radius_m:
                return obstacle
        return None

    def scan(
        self, x_m: float, y_m: float, z_m: float, yaw_rad: float, beams: int, max_m: float
    ) -> list[float]:
        """Distances to the obstacles all around at this height, first beam backwards, counter-clockwise.

        Only the beams that can meet an obstacle are followed.
        """
        ranges = [max_m] * beams
        step = math.tau / beams
        for obstacle in self.obstacles():
            if obstacle.height_m <= z_m:
                continue
            reach = obstacle.reach_m()
            away = math.hypot(obstacle.x_m - x_m, obstacle.y_m - y_m)
            if away - reach >= max_m:
                continue
            bearing = math.atan2(obstacle.y_m - y_m, obstacle.x_m - x_m) - yaw_rad + math.pi
            # within the circle around the obstacle any beam can meet it
            half = math.pi if away <= reach else math.asin(reach / away)
            first = math.ceil((bearing - half) / step)
            # at most one turn, or beams would be followed twice
            last = min(math.floor((bearing + half) / step), first + beams - 1)
            for beam in range(first, last + 1):
                angle = yaw_rad - math.pi + beam * step
                length = obstacle.hit_m(x_m, y_m, math.cos(angle), math.sin(angle))
                ranges[beam % beams] = min(ranges[beam % beams], length)
        return ranges
