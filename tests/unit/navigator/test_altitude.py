"""Altitude hold in the loop with the multirotor's lag."""

import pytest

from swarmd.navigator.config import AltitudeConfig
from swarmd.navigator.core.air_controller import AltitudeHold
from swarmd.sim.config import MultirotorLimits
from swarmd.sim.core.multirotor import Multirotor
from swarmware.types.vehicle import Pose, Setpoint


def hold(
    hover: AltitudeHold, wanted: float, start: float, seconds: float, draught: float = 0.0
) -> list[float]:
    """Heights of a vehicle in vertically moving air."""
    vehicle = Multirotor(MultirotorLimits(), Pose.planar(0.0, 0.0, start))
    vehicle.armed = True
    heights = []
    for _ in range(round(seconds * 20)):
        pose = vehicle.pose()
        climb = hover.climb_m_s(wanted, pose.z_m, pose.vz_m_s, 2.0, -1.5, 0.05)
        for _ in range(5):
            vehicle.step(Setpoint(0.0, 0.0, climb + draught), 0.01)
        heights.append(vehicle.pose().z_m)
    return heights


def test_height_is_reached_without_much_overshoot_and_held() -> None:
    heights = hold(AltitudeHold(AltitudeConfig()), 10.0, 2.0, 30.0)
    assert max(heights) < 10.5
    assert heights[-1] == pytest.approx(10.0, abs=0.05)


def test_a_steady_draught_leaves_no_error() -> None:
    assert hold(AltitudeHold(AltitudeConfig()), 10.0, 10.0, 60.0, -0.4)[-1] == pytest.approx(10.0, abs=0.05)
    lasting = hold(AltitudeHold(AltitudeConfig(ki_1_s2=0.0)), 10.0, 10.0, 60.0, -0.4)[-1]
    assert lasting < 9.8


def test_integral_does_not_wind_up_on_long_climb() -> None:
    heights = hold(AltitudeHold(AltitudeConfig()), 60.0, 0.5, 60.0)
    assert max(heights) < 60.6


def test_limits_hold() -> None:
    hover = AltitudeHold(AltitudeConfig())
    assert hover.climb_m_s(100.0, 0.0, 0.0, 2.0, -1.5, 0.05) == 2.0
    assert hover.climb_m_s(-100.0, 0.0, 0.0, 2.0, -1.5, 0.05) == -1.5


def test_reset_forgets_the_integral() -> None:
    hover = AltitudeHold(AltitudeConfig())
    for _ in range(100):
        hover.climb_m_s(1.0, 0.0, 0.0, 5.0, -5.0, 0.05)
    hover.reset()
    assert hover.climb_m_s(0.0, 0.0, 0.0, 5.0, -5.0, 0.05) == 0.0
