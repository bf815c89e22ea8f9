"""Formation error from goals and true paths whose answer is known."""

import math

import numpy as np
import pytest

from swarmlab.measure import formation_error, tracks
from swarmlab.measure.tracks import VehicleTrack
from swarmware.types.navigation import Goal, GoalKind

COURSE = ((0.0, 0.0), (100.0, 0.0))


def straight(platform: str, x_m: float, y_m: float, z_m: float = 0.0) -> VehicleTrack:
    """East at 1 m/s, from x at t = 0."""
    t_s = np.arange(0, 101) / 5
    xyz = np.stack([x_m + t_s, np.full(len(t_s), y_m), np.full(len(t_s), z_m)], axis=1)
    return VehicleTrack(platform, t_s, xyz, np.zeros(len(t_s)))


def formation(offset: tuple[float, float, float], *, advance: bool = True, seq: int = 1) -> Goal:
    return Goal(seq, GoalKind.FORMATION, leader="l", offset_m=offset, course=COURSE, advance=advance)


def test_follower_beside_slot_has_constant_error() -> None:
    leader, follower = straight("l", 20, 0), straight("f", 14, 3.5, 8.25)
    times = tracks.axis(1, 19)
    found = formation_error.errors(follower, leader, [(0.0, formation((-6, 3, 8)))], times)
    assert np.allclose(found, math.hypot(0.5, 0.25))


def test_error_is_absent_without_slot_or_follower() -> None:
    leader, follower = straight("l", 20, 0), straight("f", 14, 3)
    times = tracks.axis(0, 20)
    goals = [(5.0, formation((-6, 3, 0))), (10.0, Goal(2, GoalKind.LAND))]
    found = formation_error.errors(follower, leader, goals, times)
    assert np.isfinite(found).tolist() == [5.0 <= t < 10.0 for t in times]
    assert np.isnan(formation_error.errors(leader, leader, goals, times)).all()


def test_it_is_formed_while_all_advance() -> None:
    wait, go, land = formation((0, 0, 0), advance=False), formation((0, 0, 0)), Goal(3, GoalKind.LAND)
    goals = {
        "l": [(1.0, wait), (5.0, go), (9.0, land)],
        "f": [(2.0, wait), (6.0, go), (9.5, land)],
    }
    assert formation_error.formed_spans(goals, 20.0) == ((6.0, 9.0),)
    goals["g"] = [(2.0, wait)]
    assert formation_error.formed_spans(goals, 20.0) == ()
    assert formation_error.formed_spans({}, 20.0) == ()


def test_interrupted_formation_has_two_spans() -> None:
    go, hold = formation((0, 0, 0)), Goal(2, GoalKind.HOLD)
    goals = {"l": [(1.0, go), (3.0, go), (4.0, hold), (6.0, go)]}
    assert formation_error.formed_spans(goals, 8.0) == ((1.0, 4.0), (6.0, 8.0))


def test_leader_and_course_are_read_from_the_goals() -> None:
    goals = {"f": [(0.0, Goal(1, GoalKind.TAKEOFF)), (1.0, formation((-3, 0, 0)))]}
    assert formation_error.leader_of(goals) == "l"
    assert formation_error.course_of(goals) == COURSE
    assert formation_error.leader_of({}) == ""
    assert formation_error.course_of({}) == ()


@pytest.mark.parametrize(("t_s", "seq"), [(0.5, None), (1.0, 1), (1.5, 1), (2.0, 2), (99.0, 2)])
def test_the_goal_in_force_is_the_newest(t_s: float, seq: int | None) -> None:
    found = formation_error.goal_at([(1.0, Goal(1, GoalKind.HOLD)), (2.0, Goal(2, GoalKind.HOLD))], t_s)
    assert (found.seq if found else None) == seq
