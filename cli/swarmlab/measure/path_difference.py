"""Difference of the paths of a vehicle in two runs of one mission."""

from typing import Final

import msgspec
import numpy as np

from swarmlab.measure.tracks import Floats, VehicleTrack, axis, resample

SHIFT_S: Final = 3.0
"""Maximum difference of the instants at which two runs leave, after the same command."""
STEP_S: Final = 0.01
"""Resolution of that difference."""


class PathDifference(msgspec.Struct, frozen=True):
    """Distance of two paths, in space and in time."""

    rms_m: float
    """Distance of each point of a path to the nearest one of the other, the larger one of both directions."""
    max_m: float
    same_time_rms_m: float
    """Distance at the same time since the start."""
    shift_s: float
    """Time by which the second run began later, for which that distance is smallest."""


def difference(one: VehicleTrack, other: VehicleTrack) -> tuple[PathDifference, Floats, Floats] | None:
    """The difference, instants of the first path, and its distance to the second one at each.

    None: the paths have no common time. Units: seconds and metres.
    """
    if not len(one.t_s) or not len(other.t_s):
        return None
    times_s = axis(0.0, float(one.t_s[-1]))
    here = resample(one, times_s)
    best: tuple[float, float] | None = None
    for step in range(round(-SHIFT_S / STEP_S), round(SHIFT_S / STEP_S) + 1):
        shift_s = step * STEP_S
        apart_m = np.linalg.norm(here - resample(other, times_s + shift_s), axis=1)
        known = apart_m[np.isfinite(apart_m)]
        if len(known) < len(times_s) // 2:
            continue
        rms_m = _rms(known)
        if best is None or rms_m < best[0]:
            best = rms_m, shift_s
    if best is None:
        return None
    there = resample(other, axis(0.0, float(other.t_s[-1])))
    known_here, known_there = np.isfinite(here[:, 0]), np.isfinite(there[:, 0])
    to_other = np.full(len(times_s), np.nan)
    to_other[known_here] = _nearest(here[known_here], there[known_there])
    to_one = _nearest(there[known_there], here[known_here])
    forth, back = to_other[known_here], to_one
    found = PathDifference(
        max(_rms(forth), _rms(back)), float(max(forth.max(), back.max())), best[0], round(best[1], 2)
    )
    return found, times_s, to_other


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _nearest(points: Floats, path: Floats) -> Floats:
    """Distance of each point to the nearest one of a path. Shapes: (N, 3), (M, 3) → (N,)."""
    return np.array([np.linalg.norm(path - point, axis=1).min() for point in points])
