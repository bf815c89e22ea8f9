"""Model of the surroundings of a vehicle: the distance to the nearest obstacle in each direction."""

import math
from typing import Any

from swarmd.lidar.config import Config
from swarmd.lidar.core.turn_decoder import numpy
from swarmware.types.vehicle import Range


class ObstacleModel:
    """Reduces the points of a turn, levelled by the vehicle's attitude, to one distance for each
    direction."""

    def __init__(self, config: Config) -> None:
        """Raises: NotFound without NumPy."""
        self._np: Any = numpy()
        self._config = config
        self._step_rad = 2 * math.pi / config.beams

    def ranges(self, points: Any, roll_rad: float, pitch_rad: float) -> Range:
        """Distances of one turn; `points` has rows of x, y, z in m, in the vehicle's FLU axes."""
        np, config = self._np, self._config
        x, y, z = (points @ self._level(roll_rad, pitch_rad)).T
        distances = np.hypot(x, y)
        chosen = (
            (z >= config.low_m)
            & (z <= config.high_m)
            & (distances >= config.near_m)
            & (distances < config.max_m)
        )
        distances = distances[chosen]
        beams = np.round(np.arctan2(y[chosen], x[chosen]) / self._step_rad).astype("i4") % config.beams
        # sorted by direction, then distance, so that each direction is one ascending run
        order = np.lexsort((distances, beams))
        beams, distances = beams[order], distances[order]
        # skips the nearest `echoes - 1` points of each direction, which may be dust
        places = np.searchsorted(beams, np.arange(config.beams)) + config.echoes - 1
        ends = np.searchsorted(beams, np.arange(config.beams), side="right")
        found = np.full(config.beams, config.max_m)
        there = places < ends
        found[there] = distances[places[there]]
        return Range(0.0, self._step_rad, config.max_m, tuple(round(float(one), 3) for one in found))

    def _level(self, roll_rad: float, pitch_rad: float) -> Any:
        """Rotation of row vectors from body axes to level axes, without the heading."""
        cr, sr, cp, sp = math.cos(roll_rad), math.sin(roll_rad), math.cos(pitch_rad), math.sin(pitch_rad)
        rotation = [[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]]
        return self._np.array(rotation, "f4").T
