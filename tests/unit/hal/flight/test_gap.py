"""Inertial samples of a gap: evenly changing rates while outputs are held, a fall after the end of the
motors."""

import pytest

from swarmd.hal.core.flight.flight_core import between
from swarmware.types.vehicle import Imu

BEFORE = Imu(0.0, 0.2, -0.1, 0.0, 0.0, 10.0, 0.3)
AFTER = Imu(1.0, 0.4, -0.1, 1.0, 0.0, 8.0, 0.4)
FALLING = Imu(1.0, 0.4, -0.1, 0.0, 0.0, 0.5, 0.4)


@pytest.mark.parametrize(("at_s", "share"), [(0.1, 0.25), (0.2, 0.5), (0.4, 1.0)])
def test_rates_and_force_change_evenly_between_samples(at_s: float, share: float) -> None:
    found = between(BEFORE, AFTER, at_s, 0.4, 1.0)
    assert found.wx_rad_s == pytest.approx(share)
    assert found.wy_rad_s == pytest.approx(0.2 + 0.2 * share)
    assert found.wz_rad_s == pytest.approx(-0.1)
    assert found.az_m_s2 == pytest.approx(10.0 - 2.0 * share)
    assert found.yaw_rad is None, "the compass was not read"


@pytest.mark.parametrize(
    ("at_s", "rate", "force"), [(0.5, 0.5, 10.0), (1.0, 1.0, 10.0), (1.1, 1.0, 0.5), (1.6, 1.0, 0.5)]
)
def test_rates_stay_and_vehicle_falls_without_motors(at_s: float, rate: float, force: float) -> None:
    found = between(BEFORE, FALLING, at_s, 1.6, 1.0)
    assert (found.wx_rad_s, found.az_m_s2) == pytest.approx((rate, force))
