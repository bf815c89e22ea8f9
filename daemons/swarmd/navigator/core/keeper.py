"""Formation keeping, which computes the slot of this vehicle from the goal and the leader's pose."""

import math
from typing import Final

import msgspec

from swarmd.navigator.config import Config
from swarmd.navigator.core.target import Target
from swarmware.errors import InvalidInput
from swarmware.geometry.formation import FormationSlots, Slot
from swarmware.types.navigation import Goal
from swarmware.types.vehicle import Pose

_MOVES_M_S: Final = 0.05
_END_M: Final = 0.5
"""Distance of the leader from the end of the course at which the formation has arrived."""
_RUN_UP_M: Final = 3.0
"""Distance behind a resting slot from which a ground vehicle approaches, because it cannot move sideways."""
_BESIDE_M: Final = 0.4
_RUN_UP_DONE_M: Final = 0.7
_CREEP_M_S: Final = 0.1
"""Minimum speed of the leader, at which it reaches the end of the course."""


class SlotTarget(msgspec.Struct, frozen=True):
    """The target in the slot, and the distance of the vehicle from it."""

    target: Target
    error_m: float
    """Distance of the vehicle from its slot."""
    remaining_m: float
    """Distance of the leader from the end of the course, or 0 if the leader does not advance."""
    still: bool
    """True if the slot is at rest."""


class FormationKeeper:
    """Keeps one vehicle in its slot for the duration of one goal.

    Raises: InvalidInput when the goal's course is invalid.
    """

    __slots__ = ("_approaching", "_config", "_flies", "_formation", "_goal", "_height_m", "_ns", "_speed_m_s")

    def __init__(self, config: Config, goal: Goal, flies: bool) -> None:
        self._config = config
        self._goal = goal
        self._flies = flies
        self._formation = FormationSlots(goal.course)
        self._height_m: float | None = None
        self._approaching = False
        self._speed_m_s = 0.0
        self._ns = 0
        if goal.advance and self._formation.course is None:
            raise InvalidInput("formation that advances: expected a course of at least two waypoints")

    @property
    def has_course(self) -> bool:
        """True if the goal has a course, which a leader needs."""
        return self._formation.course is not None

    def lead(self, pose: Pose, now_ns: int) -> SlotTarget:
        """Target of the leader, its projection onto the course, which moves along the course."""
        course = self._formation.course
        if course is None:
            raise InvalidInput("leading a formation: expected a course of at least two waypoints")
        # the formation keeps the height at which it started
        if self._height_m is None:
            self._height_m = pose.z_m
        slot = self._formation.slot(pose, (0.0, 0.0, 0.0))
        s = course.project(pose.x_m, pose.y_m, slot.leader_s_m)
        remaining = course.length_m - s
        # bounded: after a pause the speed must not jump by the whole time
        dt_s = min(max((now_ns - self._ns) / 1e9, 0.0), 0.2)
        self._ns = now_ns
        config, goal = self._config, self._goal
        if goal.advance:
            # speed from which the leader can still stop at the end of the course
            braking = math.sqrt(2 * config.course_accel_m_s2 * max(0.0, remaining))
            speed = min(
                self._speed_m_s + config.course_accel_m_s2 * dt_s, goal.speed_m_s, max(braking, _CREEP_M_S)
            )
            self._speed_m_s = speed if remaining > 0.0 else 0.0
            slot = self._formation.slot_at(s, (0.0, 0.0, self._height_m), self._speed_m_s)
        else:
            self._speed_m_s = 0.0
            slot = self._formation.slot_at(slot.leader_s_m, (0.0, 0.0, self._height_m))
            remaining = 0.0
        return self._slot_target(pose, slot, (0.0, 0.0, 0.0), remaining)

    def follow(self, pose: Pose, leader: Pose) -> SlotTarget:
        """Target of a follower, its slot relative to the leader."""
        offset = self._goal.offset_m
        slot = self._formation.slot(leader, offset)
        course = self._formation.course
        remaining = 0.0
        if course is not None and self._goal.advance:
            remaining = course.length_m - slot.leader_s_m
            if remaining < _END_M:
                remaining = 0.0
        return self._slot_target(pose, slot, offset, remaining)

    def _slot_target(
        self, pose: Pose, slot: Slot, offset: tuple[float, float, float], remaining_m: float
    ) -> SlotTarget:
        still = math.hypot(slot.vx_m_s, slot.vy_m_s) < _MOVES_M_S
        error_m = slot.error_m(pose, flat=not self._flies)
        target = Target(
            slot.x_m,
            slot.y_m,
            slot.z_m,
            slot.yaw_rad,
            # a moving slot sets the speed itself, by its velocity
            self._goal.speed_m_s if still else math.inf,
            self._ahead(pose, slot, offset),
            (slot.vx_m_s, slot.vy_m_s, slot.vz_m_s),
        )
        if still and not self._flies:
            target = self._run_up(pose, target, error_m)
        else:
            self._approaching = False
        return SlotTarget(target, error_m, remaining_m, still)

    def _run_up(self, pose: Pose, target: Target, error_m: float) -> Target:
        """The target, or a point behind the target if the vehicle is beside it."""
        yaw = target.yaw_rad or 0.0
        cos, sin = math.cos(yaw), math.sin(yaw)
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        ahead, beside = dx * cos + dy * sin, abs(dy * cos - dx * sin)
        x, y = target.x_m - _RUN_UP_M * cos, target.y_m - _RUN_UP_M * sin
        if self._approaching:
            # once begun it is driven to the end, or the vehicle would turn back and forth
            self._approaching = math.hypot(x - pose.x_m, y - pose.y_m) > _RUN_UP_DONE_M
        else:
            self._approaching = (
                error_m > self._config.formation_arrive_m and beside > _BESIDE_M and ahead < beside
            )
        if not self._approaching:
            return target
        return msgspec.structs.replace(target, x_m=x, y_m=y, yaw_rad=None, ahead_m=(x, y))

    def _ahead(self, pose: Pose, slot: Slot, offset: tuple[float, float, float]) -> tuple[float, float]:
        """Look-ahead point on the path of the slot, for pure pursuit of this path."""
        config = self._config
        speed = math.hypot(pose.vx_m_s, pose.vy_m_s)
        reach = max(config.look_ahead_min_m, speed * config.look_ahead_s)
        # measured from the projection of the vehicle, so that a vehicle behind its slot does not cut corners,
        # and a vehicle ahead of its slot still aims forward while it drives back
        if self._formation.course is None:
            cos, sin = math.cos(slot.yaw_rad), math.sin(slot.yaw_rad)
            along = (pose.x_m - slot.x_m) * cos + (pose.y_m - slot.y_m) * sin + reach
            return slot.x_m + along * cos, slot.y_m + along * sin
        own_s = self._formation.course.project(pose.x_m, pose.y_m, slot.s_m)
        point = self._formation.slot_at(own_s + reach - offset[0], offset)
        return point.x_m, point.y_m
