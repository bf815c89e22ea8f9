"""Formation errors, from the goals of the navigators and the true positions of the vehicles."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from swarmlab.measure.tracks import Floats, VehicleTrack, resample, resample_yaw
from swarmware.geometry.formation import FormationSlots
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.vehicle import Pose

Goals = Sequence[tuple[float, Goal]]
"""Goals of one vehicle with their instants, in order."""


def formed_spans(goals: Mapping[str, Goals], end_s: float) -> tuple[tuple[float, float], ...]:
    """Time spans in which every vehicle had the goal to advance in formation.

    Before, they move into their slots and wait at a barrier; afterwards they land.
    """
    instants = sorted({t_s for known in goals.values() for t_s, _ in known} | {end_s})
    spans: list[tuple[float, float]] = []
    for start_s, stop_s in pairwise(instants):
        if not goals or not all(_advances(goal_at(known, start_s)) for known in goals.values()):
            continue
        # a change of the goal inside the formation does not end the span
        if spans and spans[-1][1] == start_s:
            spans[-1] = (spans[-1][0], stop_s)
        else:
            spans.append((start_s, stop_s))
    return tuple(spans)


def goal_at(goals: Goals, t_s: float) -> Goal | None:
    """The goal in force at an instant, or None before the first."""
    at = bisect_right(goals, t_s, key=lambda item: item[0]) - 1
    return goals[at][1] if at >= 0 else None


def _advances(goal: Goal | None) -> bool:
    return goal is not None and goal.kind is GoalKind.FORMATION and goal.advance


def leader_of(goals: Mapping[str, Goals]) -> str:
    """Name of the leader, or "" without a formation."""
    for known in goals.values():
        for _, goal in known:
            if goal.kind is GoalKind.FORMATION and goal.leader:
                return goal.leader
    return ""


def course_of(goals: Mapping[str, Goals]) -> tuple[tuple[float, float], ...]:
    """Waypoints of the formation, or none without a course."""
    courses = [
        goal.course for known in goals.values() for _, goal in known if goal.kind is GoalKind.FORMATION
    ]
    # the longest, as goals of a formation may have no course
    return max(courses, key=len, default=())


def errors(track: VehicleTrack, leader: VehicleTrack, goals: Goals, times_s: Floats) -> Floats:
    """Distance of a follower from its slot at each instant; NaN where it had none. Shapes: (T,) → (T,).

    The slot is computed from the true pose of the leader, not from the estimate of the follower.
    """
    out = np.full(len(times_s), np.nan)
    own, lead = resample(track, times_s), resample(leader, times_s)
    yaw = resample_yaw(leader, times_s)
    formations: dict[tuple[tuple[float, float], ...], FormationSlots] = {}
    for i, t_s in enumerate(times_s):
        goal = goal_at(goals, float(t_s))
        if goal is None or goal.kind is not GoalKind.FORMATION or goal.leader in {"", track.platform}:
            continue
        if not (np.isfinite(own[i, 0]) and np.isfinite(lead[i, 0])):
            continue
        if goal.course not in formations:
            formations[goal.course] = FormationSlots(goal.course)
        formation = formations[goal.course]
        x_m, y_m, z_m = (float(value) for value in lead[i])
        slot = formation.slot(Pose.planar(x_m, y_m, z_m, float(yaw[i])), goal.offset_m)
        out[i] = slot.error_m(Pose(float(own[i, 0]), float(own[i, 1]), float(own[i, 2])))
    return out
