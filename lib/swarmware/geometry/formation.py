"""The formation: places of the slots in a shape, and their present positions."""

import math
from typing import Final, Literal, get_args

import msgspec

from swarmware.errors import InvalidInput
from swarmware.geometry.course import Course
from swarmware.types.vehicle import Pose

Shape = Literal["wedge", "line", "column"]
SHAPES: Final[tuple[str, ...]] = get_args(Shape)


class Slot(msgspec.Struct, frozen=True, gc=False):
    """Position and velocity that a member of the formation should have."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    s_m: float
    """Distance of the slot along the course, or 0 without a course."""
    leader_s_m: float
    """Distance of the leader along the course for this slot."""
    stretch: float
    """Ratio of its speed to the leader's: above 1 outside of a turn, below 1 inside."""

    def error_m(self, pose: Pose, *, flat: bool = False) -> float:
        """Distance of a vehicle from its slot; `flat`: without the height."""
        height = 0.0 if flat else pose.z_m - self.z_m
        return math.hypot(pose.x_m - self.x_m, pose.y_m - self.y_m, height)


def place(shape: str, slot: int, spacing_m: float) -> tuple[float, float]:
    """Forward and left distance of a slot from the head of the shape, which is slot 0.

    The others are left and right in turn; in a wedge each pair is one row further back.
    Raises: InvalidInput for an unknown shape or a negative slot.
    """
    if slot < 0:
        raise InvalidInput(f"slot {slot}: expected 0 or more")
    row = (slot + 1) // 2
    side = 1 if slot % 2 else -1
    if shape == "wedge":
        return -row * spacing_m, side * row * spacing_m
    if shape == "line":
        return 0.0, side * row * spacing_m
    if shape == "column":
        return -slot * spacing_m, 0.0
    raise InvalidInput(f"shape {shape!r}: expected one of {', '.join(SHAPES)}")


class FormationSlots:
    """Slots of a formation that follows a leader.

    With a course, places are measured along it and across it: a slot follows a curve parallel to the
    leader's, also when the leader swerves. Its place behind the leader is a former place of the leader.
    Without a course the shape is rigid and turns with the leader.
    Before the beginning of the course the slots are at rest.
    Source: Barfoot, Clark: Motion planning for formations of mobile robots, 2004 (curvilinear coordinates).
    """

    __slots__ = ("_near_m", "course")

    def __init__(self, course: tuple[tuple[float, float], ...] = ()) -> None:
        self.course = Course(course) if course else None
        self._near_m: float | None = None

    def slot(self, leader: Pose, offset_m: tuple[float, float, float]) -> Slot:
        """The present slot, from the leader's pose."""
        if self.course is None:
            return _rigid(leader, offset_m)
        forward, left, up = offset_m
        s = self.course.project(leader.x_m, leader.y_m, self._near_m)
        # the next search begins here: a course may pass the same place twice
        self._near_m = s
        clipped = min(max(s, 0.0), self.course.length_m)
        here = self.course.at(clipped)
        speed = 0.0
        # before and behind the course the slots are at rest
        if s == clipped:
            cos, sin = math.cos(here.heading_rad), math.sin(here.heading_rad)
            across = (leader.y_m - here.y_m) * cos - (leader.x_m - here.x_m) * sin
            along = leader.vx_m_s * cos + leader.vy_m_s * sin
            # progress of the foot point: on the outside of a curve it is less than the distance that the
            # leader moves
            speed = along / max(0.2, 1 - here.curvature_1_m * across)
        return self.slot_at(clipped, (forward, left, leader.z_m + up), speed)

    def slot_at(self, s_m: float, offset_m: tuple[float, float, float], speed_m_s: float = 0.0) -> Slot:
        """The slot when the leader is at `s_m`; the third offset is the absolute height here."""
        if self.course is None:
            raise InvalidInput("slot along a course: this formation has none")
        forward, left, up = offset_m
        point = self.course.at(s_m + forward)
        cos, sin = math.cos(point.heading_rad), math.sin(point.heading_rad)
        # inside of a curve that is tighter than the offset the slot would run backwards
        stretch = max(0.0, 1 - point.curvature_1_m * left)
        speed = speed_m_s * stretch
        return Slot(
            point.x_m - left * sin,
            point.y_m + left * cos,
            up,
            point.heading_rad,
            speed * cos,
            speed * sin,
            0.0,
            s_m + forward,
            s_m,
            stretch,
        )


def _rigid(leader: Pose, offset_m: tuple[float, float, float]) -> Slot:
    forward, left, up = offset_m
    yaw = leader.yaw_rad
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx = forward * cos - left * sin
    dy = forward * sin + left * cos
    return Slot(
        leader.x_m + dx,
        leader.y_m + dy,
        leader.z_m + up,
        yaw,
        leader.vx_m_s - leader.wz_rad_s * dy,
        leader.vy_m_s + leader.wz_rad_s * dx,
        leader.vz_m_s,
        0.0,
        0.0,
        1.0,
    )
