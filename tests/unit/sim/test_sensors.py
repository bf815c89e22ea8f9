"""Sensor errors with the configured size, and without a mean error."""

import math
import random
from itertools import pairwise
from statistics import mean, stdev

import pytest

from swarmd.sim.config import SensorsConfig
from swarmd.sim.core.sensors import SensorErrors
from swarmware.geometry.geodesy import GRAVITY_M_S2, LocalMap
from swarmware.geometry.world import Bounds, Circle, World
from swarmware.types.vehicle import Pose

WORLD = World(
    description="",
    bounds=Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0)),
    circles=(Circle(name="tree", x_m=5.0, y_m=0.0, radius_m=1.0, height_m=3.0),),
)
TRUTH = Pose.planar(0.0, 0.0, 1.0, 0.3, (1.0, 2.0, 0.0), 0.4)


def sensors(seed: int = 1, config: SensorsConfig | None = None) -> SensorErrors:
    chance = random.Random(seed)
    return SensorErrors(config or SensorsConfig(), WORLD, chance.gauss, chance.random)


def test_without_errors_a_fix_is_the_truth() -> None:
    exact = sensors(1, SensorsConfig(gnss_sigma_m=0.0, gnss_bias_sigma_m=0.0))
    fix = exact.gnss(TRUTH, 0.1)
    assert LocalMap(WORLD.origin).to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m) == pytest.approx(
        (0.0, 0.0, 1.0), abs=1e-6
    )


def test_fixes_scatter_as_much_as_configured() -> None:
    local = LocalMap(WORLD.origin)
    easts, heights = [], []
    for seed in range(40):
        errors = sensors(seed)
        for _ in range(25):
            fix = errors.gnss(TRUTH, 0.1)
            east, _, up = local.to_local(fix.lat_deg, fix.lon_deg, fix.alt_ellipsoid_m)
            easts.append(east)
            heights.append(up - 1.0)
    expected = math.hypot(0.02, 0.03)
    assert stdev(easts) == pytest.approx(expected, rel=0.3)
    assert stdev(heights) == pytest.approx(1.5 * expected, rel=0.3)
    assert abs(mean(easts)) < 0.02


def test_the_slow_error_wanders_slowly() -> None:
    config = SensorsConfig(gnss_sigma_m=0.0, gnss_bias_sigma_m=1.0)
    errors, local = sensors(3, config), LocalMap(WORLD.origin)
    fixes = [errors.gnss(TRUTH, 0.1) for _ in range(600)]
    easts = [local.to_local(f.lat_deg, f.lon_deg, f.alt_ellipsoid_m)[0] for f in fixes]
    steps = [abs(b - a) for a, b in pairwise(easts)]
    assert max(steps) < 0.3
    assert max(easts) - min(easts) > 0.3


def test_the_inertial_unit_feels_gravity_rate_and_heading() -> None:
    errors = sensors()
    samples = [errors.imu(TRUTH, (0.2, 0.1, 0.4), (0.5, -0.2, GRAVITY_M_S2 + 0.1)) for _ in range(400)]
    assert mean(s.wx_rad_s for s in samples) == pytest.approx(0.2, abs=0.005)
    assert mean(s.wy_rad_s for s in samples) == pytest.approx(0.1, abs=0.005)
    assert mean(s.wz_rad_s for s in samples) == pytest.approx(0.4, abs=0.005)
    assert mean(s.ax_m_s2 for s in samples) == pytest.approx(0.5, abs=0.02)
    assert mean(s.az_m_s2 for s in samples) == pytest.approx(GRAVITY_M_S2 + 0.1, abs=0.02)
    assert mean(s.yaw_rad or 0.0 for s in samples) == pytest.approx(0.3, abs=0.04)
    assert stdev(s.wz_rad_s for s in samples) == pytest.approx(0.01, rel=0.2)


def test_scan_sees_tree_and_clear_is_maximum() -> None:
    scan = sensors().scan(Pose.planar(0.0, 0.0), 0.3)
    assert len(scan.ranges_m) == 72
    assert scan.angle_min_rad == -math.pi
    ahead = scan.ranges_m[36]
    assert ahead == pytest.approx(4.0, abs=0.1)
    assert scan.ranges_m[0] == scan.max_m
    assert sensors().scan(Pose.planar(0.0, 0.0, 5.0), 5.0).ranges_m == (scan.max_m,) * 72


def test_some_echoes_of_sonar_come_from_somewhere_else() -> None:
    errors = sensors(1, SensorsConfig(sonar_outliers_ratio=0.1))
    far = sum(abs(errors.sonar(2.0).ranges_m[0] - 2.0) > 0.2 for _ in range(1000))
    assert 50 < far < 130
    assert errors.sonar(50.0).ranges_m[0] <= 6.45


def test_every_platform_draws_own_repeatable_numbers() -> None:
    assert sensors(7).gnss(TRUTH, 0.1) == sensors(7).gnss(TRUTH, 0.1)
    assert sensors(7).gnss(TRUTH, 0.1) != sensors(8).gnss(TRUTH, 0.1)
