"""Formation: places in a shape, slots along a course and behind a leader."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput
from swarmware.geometry.formation import FormationSlots, place
from swarmware.types.vehicle import Pose

COURSE = ((0.0, 0.0), (32.0, 0.0), (62.0, 20.0), (95.0, 20.0))


@pytest.mark.parametrize(
    ("shape", "slot", "expected"),
    [
        ("wedge", 0, (0.0, 0.0)),
        ("wedge", 1, (-4.0, 4.0)),
        ("wedge", 2, (-4.0, -4.0)),
        ("wedge", 5, (-12.0, 12.0)),
        ("line", 0, (0.0, 0.0)),
        ("line", 3, (0.0, 8.0)),
        ("line", 4, (0.0, -8.0)),
        ("column", 3, (-12.0, 0.0)),
    ],
)
def test_places_of_a_shape(shape: str, slot: int, expected: tuple[float, float]) -> None:
    assert place(shape, slot, 4.0) == expected


@pytest.mark.parametrize("shape", ["wedge", "line", "column"])
def test_no_two_slots_are_closer_than_the_spacing(shape: str) -> None:
    places = [place(shape, slot, 3.0) for slot in range(20)]
    assert min(math.dist(a, b) for i, a in enumerate(places) for b in places[:i]) >= 3.0


def test_unknown_shape_is_refused_with_known_ones() -> None:
    with pytest.raises(InvalidInput, match="expected one of wedge, line, column"):
        place("blob", 1, 1.0)
    with pytest.raises(InvalidInput, match="expected 0 or more"):
        place("wedge", -1, 1.0)


def test_slots_wait_at_beginning_until_leader_is_there() -> None:
    slot = FormationSlots(COURSE).slot(Pose.planar(-12.0, 0.5, 0.0, 0.0, (1.5, 0.0, 0.0)), (-4.0, 4.0, 0.0))
    assert (slot.x_m, slot.y_m) == pytest.approx((-4.0, 4.0))
    assert (slot.vx_m_s, slot.vy_m_s) == (0.0, 0.0)


def test_slot_on_straight_leg_moves_with_leader() -> None:
    slot = FormationSlots(COURSE).slot(Pose.planar(12.0, 0.0, 0.0, 0.0, (2.0, 0.0, 0.0)), (-4.0, 4.0, 8.0))
    assert (slot.x_m, slot.y_m, slot.z_m) == pytest.approx((8.0, 4.0, 8.0))
    assert (slot.vx_m_s, slot.vy_m_s, slot.stretch) == pytest.approx((2.0, 0.0, 1.0))


def test_the_slot_does_not_swerve_with_the_leader() -> None:
    formation = FormationSlots(COURSE)
    on_course = formation.slot(Pose.planar(12.0, 0.0), (-4.0, 4.0, 0.0))
    beside = formation.slot(Pose.planar(12.0, 1.5, 0.0, 0.7), (-4.0, 4.0, 0.0))
    assert (beside.x_m, beside.y_m) == pytest.approx((on_course.x_m, on_course.y_m))


@given(st.floats(1, 95), st.floats(-16, 16), st.floats(-20, 0))
def test_velocity_of_slot_is_change_of_its_place(s: float, left: float, forward: float) -> None:
    formation = FormationSlots(COURSE)
    assert formation.course is not None
    here = formation.course.at(s)
    speed, dt = 2.0, 1e-4
    pose = Pose.planar(
        here.x_m,
        here.y_m,
        0.0,
        here.heading_rad,
        (speed * math.cos(here.heading_rad), speed * math.sin(here.heading_rad), 0.0),
    )
    offset = (forward, left, 0.0)
    now = formation.slot(pose, offset)
    later = formation.slot_at(now.leader_s_m + speed * dt, offset)
    if (
        abs(
            formation.course.at(s + forward + speed * dt).curvature_1_m
            - formation.course.at(s + forward).curvature_1_m
        )
        < 1e-9
    ):
        assert (later.x_m - now.x_m) / dt == pytest.approx(now.vx_m_s, abs=0.01)
        assert (later.y_m - now.y_m) / dt == pytest.approx(now.vy_m_s, abs=0.01)


def test_outside_of_a_turn_a_slot_is_faster() -> None:
    formation = FormationSlots(COURSE)
    outside = formation.slot_at(35.0, (0.0, -15.0, 0.0), 2.0)
    inside = formation.slot_at(35.0, (0.0, 15.0, 0.0), 2.0)
    assert outside.stretch == pytest.approx(1.5)
    assert inside.stretch == pytest.approx(0.5)


def test_shape_without_course_turns_with_leader() -> None:
    leader = Pose.planar(10.0, 5.0, 3.0, math.pi / 2, (0.0, 1.0, 0.0), 0.2)
    slot = FormationSlots().slot(leader, (-4.0, 2.0, 1.0))
    assert (slot.x_m, slot.y_m, slot.z_m) == pytest.approx((8.0, 1.0, 4.0))
    # v + ω × r with r = (-2, -4)
    assert (slot.vx_m_s, slot.vy_m_s) == pytest.approx((0.8, 0.6))


def test_error_counts_height_only_for_those_that_fly() -> None:
    slot = FormationSlots(COURSE).slot_at(10.0, (0.0, 0.0, 8.0))
    pose = Pose.planar(13.0, 4.0, 20.0)
    assert slot.error_m(pose, flat=True) == pytest.approx(5.0)
    assert slot.error_m(pose) == pytest.approx(13.0)
