"""Sensor models, which add measurement errors to the true state."""

import math
from collections.abc import Callable
from typing import Final

from swarmd.sim.config import SensorsConfig
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GNSS_HEIGHT_RATIO, LocalMap
from swarmware.geometry.world import World
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range

_SATELLITES: Final = 17

Gauss = Callable[[float, float], float]
"""Function that draws from a normal distribution with mean and sigma."""
Uniform = Callable[[], float]
"""Function that draws from the uniform distribution from 0 to 1."""


class SensorErrors:
    """Sensors of one vehicle, each with bias and noise."""

    __slots__ = (
        "_bias_m",
        "_config",
        "_gauss",
        "_map",
        "_uniform",
        "_world",
        "_yaw_bias_rad",
    )

    def __init__(self, config: SensorsConfig, world: World, gauss: Gauss, uniform: Uniform) -> None:
        self._config = config
        self._world = world
        self._map = LocalMap(world.origin)
        self._gauss = gauss
        self._uniform = uniform
        self._yaw_bias_rad = gauss(0.0, config.yaw_bias_sigma_rad)
        # begins in its stationary distribution, so that no time is needed to settle
        self._bias_m = [gauss(0.0, config.gnss_bias_sigma_m) for _ in range(3)]

    def gnss(self, pose: Pose, since_s: float) -> GnssFix:
        """Measures a position fix; `since_s`: time since the previous fix."""
        sigma = self._config.gnss_sigma_m
        # first-order Gauss-Markov process, whose driving noise keeps the variance constant
        correlation = math.exp(-since_s / self._config.gnss_bias_tau_s)
        drive_m = self._config.gnss_bias_sigma_m * math.sqrt(1 - correlation**2)
        for axis in range(3):
            self._bias_m[axis] = self._bias_m[axis] * correlation + self._gauss(0.0, drive_m)
        lat, lon, alt = self._map.to_wgs84(
            pose.x_m + self._bias_m[0] + self._gauss(0.0, sigma),
            pose.y_m + self._bias_m[1] + self._gauss(0.0, sigma),
            pose.z_m + (self._bias_m[2] + self._gauss(0.0, sigma)) * GNSS_HEIGHT_RATIO,
        )
        accuracy = math.hypot(sigma, self._config.gnss_bias_sigma_m)
        return GnssFix(lat, lon, alt, accuracy, _SATELLITES)

    def imu(self, pose: Pose, rates: Vector, specific_force: Vector) -> Imu:
        """Measures rates and specific force in body axes, and the heading."""
        config, gauss = self._config, self._gauss
        rate, force = config.gyro_sigma_rad_s, config.accel_sigma_m_s2
        return Imu(
            gauss(rates[0], rate),
            gauss(rates[1], rate),
            gauss(rates[2], rate),
            gauss(specific_force[0], force),
            gauss(specific_force[1], force),
            gauss(specific_force[2], force),
            math.remainder(gauss(pose.yaw_rad + self._yaw_bias_rad, config.yaw_sigma_rad), math.tau),
        )

    def scan(self, pose: Pose, height_m: float) -> Range:
        """Measures distances to obstacles at the scanner's height; beams without an echo have the maximum
        range."""
        config = self._config
        sigma, max_m = config.range_sigma_m, config.range_max_m
        found = self._world.scan(pose.x_m, pose.y_m, height_m, pose.yaw_rad, config.range_beams, max_m)
        ranges = tuple(
            max_m if length >= max_m else round(min(max(self._gauss(length, sigma), 0.0), max_m), 3)
            for length in found
        )
        return Range(-math.pi, math.tau / config.range_beams, max_m, ranges)

    def sonar(self, height_m: float) -> Range:
        """Measures the height above the ground, with outliers (S2.49)."""
        config = self._config
        max_m = config.sonar_max_m
        # echoes of other objects, anywhere in the range
        if self._uniform() < config.sonar_outliers_ratio:
            height_m = self._uniform() * max_m
        length = min(max(self._gauss(height_m, config.sonar_sigma_m), 0.0), max_m)
        return Range(0.0, 0.0, max_m, (round(length, 3),))
