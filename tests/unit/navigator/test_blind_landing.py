"""A landing without a valid position: down by the height alone."""

import pytest
from tests.unit.navigator.rig import Rig

from swarmd.navigator.config import Config
from swarmware.types.navigation import Goal, GoalKind

TOUCH_DOWN_M_S = Config().air.touch_down_m_s


def lost(kind: GoalKind, z_m: float = 8.0, height_m: float | None = None, name: str = "uav") -> Rig:
    rig = Rig(name, z_m=z_m).go(1.0)
    rig.gnss = False
    rig.go(3.0).goal(Goal(1, kind, speed_m_s=1.2))
    if height_m is not None:
        rig.navigator.on_height(height_m)
    return rig.go(0.3)


@pytest.mark.parametrize(
    ("kind", "height_m", "sink_m_s"),
    [
        (GoalKind.LAND, None, TOUCH_DOWN_M_S),
        (GoalKind.LAND, 6.0, 1.2),
        (GoalKind.LAND, 1.0, TOUCH_DOWN_M_S),
        (GoalKind.DESCEND, None, TOUCH_DOWN_M_S),
        (GoalKind.DESCEND, 6.0, TOUCH_DOWN_M_S),
    ],
)
def test_vehicle_without_position_descends_level_by_height(
    kind: GoalKind, height_m: float | None, sink_m_s: float
) -> None:
    rig = lost(kind, height_m=height_m)
    set_to = rig.last.setpoint
    assert (set_to.vx_m_s, set_to.vy_m_s, set_to.vz_m_s, set_to.wz_rad_s) == (0.0, 0.0, -sink_m_s, 0.0)
    assert (rig.status.state, rig.status.error.value) == ("moving", "")
    assert rig.status.note == "lands by height alone"
    assert rig.status.distance_m == (height_m or 0.0)


def test_a_height_that_is_old_does_not_count() -> None:
    rig = lost(GoalKind.LAND, height_m=6.0).go(1.5)
    assert rig.last.setpoint.vz_m_s == -TOUCH_DOWN_M_S


@pytest.mark.parametrize("kind", [GoalKind.LAND, GoalKind.DESCEND])
def test_on_the_ground_it_has_arrived(kind: GoalKind) -> None:
    rig = lost(kind)
    rig.vehicle(True, True)
    rig.go(0.1)
    assert (rig.status.state, rig.stands) == ("arrived", True)


def test_landing_uses_position_valid_again() -> None:
    rig = lost(GoalKind.LAND)
    rig.gnss = True
    rig.go(2.0)
    assert rig.last.setpoint.vz_m_s == pytest.approx(-1.2, abs=0.2)
    assert rig.status.note == ""


def test_emergency_landing_does_not_look_at_position() -> None:
    rig = Rig(z_m=8.0).go(1.0)
    rig.truth = type(rig.truth).planar(3.0, 0.0, 8.0)
    rig.goal(Goal(1, GoalKind.DESCEND)).go(1.0)
    assert (rig.last.setpoint.vx_m_s, rig.last.setpoint.vz_m_s) == (0.0, -TOUCH_DOWN_M_S)


def test_other_goals_hold_without_a_position() -> None:
    rig = lost(GoalKind.GOTO)
    assert (rig.status.state, rig.status.error, rig.stands) == ("holding", "no_position", True)


@pytest.mark.parametrize(
    ("kind", "state", "error"),
    [(GoalKind.LAND, "holding", "no_position"), (GoalKind.DESCEND, "arrived", "")],
)
def test_a_ground_vehicle_stops(kind: GoalKind, state: str, error: str) -> None:
    rig = lost(kind, name="ugv")
    assert (rig.status.state.value, rig.status.error.value, rig.stands) == (state, error, True)
