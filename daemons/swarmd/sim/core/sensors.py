"""What the sensors say: the truth with their errors on it."""

import math
from collections.abc import Callable
from typing import Final

from swarmd.sim.config import Sensors
from swarmware.geodesy import LocalMap
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range
from swarmware.world import World

GRAVITY_M_S2: Final = 9.80665
_HEIGHT_FACTOR: Final = 1.5
"""Satellites are all above: heights are about this much worse than positions."""
_SATELLITES: Final = 17

Gauss = Callable[[float, float], float]
"""A throw from a normal distribution: mean, sigma."""
Uniform = Callable[[], float]
"""A throw from 0 to 1."""


class SensorErrors:
    """The sensors of one vehicle, each with its own slow and fast errors."""

    __slots__ = (
        "_bias_m",
        "_config",
        "_gauss",
        "_keep",
        "_map",
        "_stir_m",
        "_uniform",
        "_world",
        "_yaw_bias_rad",
    )

    def __init__(self, config: Sensors, world: World, gauss: Gauss, uniform: Uniform) -> None:
        self._config = config
        self._world = world
        self._map = LocalMap(world.origin)
        self._gauss = gauss
        self._uniform = uniform
        self._yaw_bias_rad = gauss(0.0, config.yaw_bias_sigma_rad)
        # first-order Gauss-Markov process, sampled at the receiver's rate
        self._keep = math.exp(-1 / (config.gnss_hz * config.gnss_bias_tau_s))
        self._stir_m = config.gnss_bias_sigma_m * math.sqrt(1 - self._keep**2)
        self._bias_m = [gauss(0.0, config.gnss_bias_sigma_m) for _ in range(3)]

    def gnss(self, pose: Pose) -> GnssFix:
        """A position fix."""
        sigma = self._config.gnss_sigma_m
        for axis in range(3):
            self._bias_m[axis] = self._bias_m[axis] * self._keep + self._gauss(0.0, self._stir_m)
        lat, lon, alt = self._map.to_wgs84(
            pose.x_m + self._bias_m[0] + self._gauss(0.0, sigma),
            pose.y_m + self._bias_m[1] + self._gauss(0.0, sigma),
            pose.z_m + (self._bias_m[2] + self._gauss(0.0, sigma)) * _HEIGHT_FACTOR,
        )
        accuracy = math.hypot(sigma, self._config.gnss_bias_sigma_m)
        return GnssFix(lat, lon, alt, accuracy, _SATELLITES)

    def imu(self, pose: Pose, acceleration: tuple[float, float, float]) -> Imu:
        """Rates, specific force and heading."""
        config, gauss = self._config, self._gauss
        rate, force = config.gyro_sigma_rad_s, config.accel_sigma_m_s2
        return Imu(
            gauss(0.0, rate),
            gauss(0.0, rate),
            gauss(pose.wz_rad_s, rate),
            gauss(acceleration[0], force),
            gauss(acceleration[1], force),
            gauss(acceleration[2] + GRAVITY_M_S2, force),
            math.remainder(gauss(pose.yaw_rad + self._yaw_bias_rad, config.yaw_sigma_rad), math.tau),
        )

    def scan(self, pose: Pose, height_m: float) -> Range:
        """Distances to what stands around, at the scanner's height; no echo is the greatest distance."""
        config = self._config
        sigma, most = config.range_sigma_m, config.range_max_m
        found = self._world.scan(pose.x_m, pose.y_m, height_m, pose.yaw_rad, config.range_beams, most)
        ranges = tuple(
            most if length >= most else round(min(max(self._gauss(length, sigma), 0.0), most), 3)
            for length in found
        )
        return Range(-math.pi, math.tau / config.range_beams, most, ranges)

    def sonar(self, height_m: float) -> Range:
        """Height above the ground; some echoes are somebody else's (S2.49)."""
        config = self._config
        most = config.sonar_max_m
        if self._uniform() < config.sonar_outliers_ratio:
            height_m = self._uniform() * most
        length = min(max(self._gauss(height_m, config.sonar_sigma_m), 0.0), most)
        return Range(0.0, 0.0, most, (round(length, 3),))
