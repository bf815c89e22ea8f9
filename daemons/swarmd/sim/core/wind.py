"""Model of the wind, with a mean, and gusts as a first-order Gauss-Markov process along each axis."""

import math
from collections.abc import Callable

from swarmd.sim.config import WindConfig
from swarmware.geometry.attitude import Vector


class GustyWind:
    """Velocity of the air around one vehicle.

    Source: MIL-F-8785C, section 3.7 (Dryden form), with a time constant in place of length divided by speed,
    because a hovering vehicle has no speed.
    """

    __slots__ = ("_config", "_gauss", "_gust")

    def __init__(self, config: WindConfig, gauss: Callable[[float, float], float]) -> None:
        self._config = config
        self._gauss = gauss
        self._gust = [0.0, 0.0, 0.0]

    def __call__(self, dt_s: float) -> Vector:
        """Advances the wind by a duration; returns its velocity in the map."""
        config, gust = self._config, self._gust
        if config.gust_sigma_m_s > 0.0:
            correlation = math.exp(-dt_s / config.gust_tau_s)
            drive = config.gust_sigma_m_s * math.sqrt(1 - correlation**2)
            for axis in range(3):
                gust[axis] = gust[axis] * correlation + self._gauss(0.0, drive)
        x, y, z = config.mean_m_s
        return x + gust[0], y + gust[1], z + gust[2]
