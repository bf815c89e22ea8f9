"""Filters with fixes that have no accuracy, no height or no position."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.hal.core.flight.motion_filter import MotionFilter
from swarmd.navigator.config import EstimatorConfig
from swarmd.navigator.core.estimator import Estimator
from swarmware.geometry.geodesy import GRAVITY_M_S2, LocalMap, Origin
from swarmware.geometry.kalman_axis import KalmanAxis
from swarmware.types.vehicle import GnssFix, Imu, Pose

ORIGIN = Origin(lat_deg=48.0, lon_deg=11.0, alt_ellipsoid_m=500.0)
MS = 1_000_000
NONE = (0.0, -1.0, math.nan, math.inf, -math.inf)
ANY = st.one_of(st.floats(-1e9, 1e9), st.sampled_from([0.0, math.nan, math.inf, -math.inf]))


def fix(x_m: float, y_m: float, z_m: float = 0.0, accuracy_m: float = 0.5) -> GnssFix:
    lat_deg, lon_deg, height_m = LocalMap(ORIGIN).to_wgs84(x_m, y_m, 0.0 if math.isnan(z_m) else z_m)
    return GnssFix(lat_deg, lon_deg, math.nan if math.isnan(z_m) else height_m, accuracy_m, 8)


def estimated(estimator: Estimator, fixes: list[GnssFix], start_ms: int = 0) -> Pose | None:
    """The pose after fixes at 10 Hz, of a vehicle whose inertial unit measures no motion."""
    for at, each in enumerate(fixes, start=1):
        now_ns = (start_ms + 100 * at) * MS
        estimator.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY_M_S2, 0.0), now_ns)
        estimator.on_gnss(each, now_ns)
        estimator.predict(now_ns)
    return estimator.pose()


@pytest.mark.parametrize("accuracy_m", NONE)
def test_missing_accuracy_counts_as_bad(accuracy_m: float) -> None:
    assert fix(0, 0, 0, accuracy_m).sigma_m == 15.0
    estimator = Estimator(EstimatorConfig(), ORIGIN)
    estimated(estimator, [fix(0.0, 0.0)] * 20)
    found = estimated(estimator, [fix(10.0, 0.0, 0.0, accuracy_m)], 2000)
    assert found is not None
    assert abs(found.x_m) < 1.0, "the fix has little weight beside those of known accuracy"


def test_a_small_accuracy_has_a_floor() -> None:
    assert [fix(0, 0, 0, sigma_m).sigma_m for sigma_m in (1e-9, 0.01, 0.02)] == [0.01, 0.01, 0.02]


@given(ANY, ANY, ANY, ANY, ANY)
def test_no_measurement_divides_by_zero_or_resets(
    position: float, sigma: float, second: float, other: float, variance: float
) -> None:
    axis = KalmanAxis(0.0, sigma, 0.0)
    for _ in range(3):
        axis.update(position, sigma)
        axis.update(second, 0.0)
        axis.average(position, 0.0)
        axis.average(second, variance)
        axis.predict(0.0, 0.1)
        axis.update(other, other)
    assert all(math.isfinite(one) for one in (axis.p, axis.v, axis.pp, axis.pv, axis.vv))


def test_zero_errors_do_not_end_the_flight_controller() -> None:
    motion = MotionFilter()
    for at in range(1, 50):
        motion.on_fix(GnssFix(48.0, 11.0, 500.0, 0.0 if at > 5 else 0.1, 8), at, at)
        motion.predict((0.0, 0.0, GRAVITY_M_S2), 0.01, landed=at % 2 == 0)
    assert motion.position_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("bad", [fix(0, 0, 0, 10.1), fix(0, 0, 0, 0.0), fix(0, 0, math.nan)])
def test_flight_controller_begins_its_map_at_good_fix(bad: GnssFix) -> None:
    motion = MotionFilter(10.0)
    motion.on_fix(bad, 1, 1)
    motion.predict((1.0, 0.0, GRAVITY_M_S2), 1.0, landed=False)
    assert motion.velocity_m_s == (0.0, 0.0, 0.0)
    motion.on_fix(fix(500.0, 0.0, 20.0, 9.9), 2, 2)
    motion.predict((1.0, 0.0, GRAVITY_M_S2), 1.0, landed=False)
    assert motion.velocity_m_s[0] == pytest.approx(1.0)
    assert motion.position_m[0] == pytest.approx(0.5), "the origin is the good fix"


def test_two_dimensional_fixes_keep_controllers_height() -> None:
    motion = MotionFilter()
    motion.on_fix(fix(0.0, 0.0, 10.0, 0.1), 1, 1)
    for at in range(2, 200):
        motion.on_fix(fix(3.0, 0.0, math.nan, 0.1), at, at)
    assert motion.position_m == pytest.approx((3.0, 0.0, 0.0), abs=0.1)


@pytest.mark.parametrize("place", [(math.nan, 11.0), (48.0, math.nan), (math.inf, 11.0)])
def test_a_fix_without_a_place_is_none(place: tuple[float, float]) -> None:
    motion, estimator = MotionFilter(), Estimator(EstimatorConfig(), ORIGIN)
    nowhere = GnssFix(*place, 500.0, 0.5, 8)
    motion.on_fix(nowhere, 5, 5)
    assert motion.fix_ns < 0
    assert estimated(estimator, [nowhere] * 5) is None


def test_a_vehicle_that_flies_needs_heights() -> None:
    estimator = Estimator(EstimatorConfig(), ORIGIN, flies=True)
    flat = [fix(1.0, 2.0, math.nan)] * 15
    assert estimated(estimator, flat) is None
    found = estimated(estimator, [fix(1.0, 2.0, 30.0)] * 10, 1500)
    assert found is not None
    assert (found.x_m, found.y_m, found.z_m) == pytest.approx((1.0, 2.0, 30.0), abs=0.3)
    found = estimated(estimator, [fix(4.0, 2.0, math.nan)] * 8, 2500)
    assert found is not None, "the height is not older than the time-out"
    assert found.z_m == pytest.approx(30.0, abs=0.5)
    assert found.x_m > 2.0, "the horizontal position follows"
    assert estimated(estimator, [fix(4.0, 2.0, math.nan)] * 5, 3300) is None
    estimator.on_height(28.0)
    found = estimated(estimator, [fix(4.0, 2.0, math.nan)] * 2, 3800)
    assert found is not None, "the sonar measures the height"
    assert found.z_m == pytest.approx(28.0, abs=0.5)


def test_a_ground_vehicle_keeps_its_height_without_one() -> None:
    estimator = Estimator(EstimatorConfig(), ORIGIN, flies=False)
    found = estimated(estimator, [fix(5.0, 6.0, math.nan)] * 30)
    assert found is not None
    assert (found.x_m, found.y_m, found.z_m) == pytest.approx((5.0, 6.0, 0.0), abs=0.1)
    estimated(estimator, [fix(5.0, 6.0, 12.0)] * 50, 3000)
    found = estimated(estimator, [fix(7.0, 6.0, math.nan)] * 100, 8000)
    assert found is not None
    assert (found.x_m, found.z_m) == pytest.approx((7.0, 12.0), abs=0.3)
