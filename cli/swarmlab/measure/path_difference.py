"""Difference of the paths of a vehicle in two runs of one mission."""

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numpy as np

from swarmlab.measure.tracks import Floats, VehicleTrack, axis, resample


class PhaseDifference(msgspec.Struct, frozen=True):
    """Distance in one phase of the mission, at the same time since it began."""

    phase: str
    """Block of the mission."""
    begin_s: float
    """Begin of the phase in the first run, since the command."""
    later_s: float
    """Time by which the second run began it later."""
    rms_m: float


class PathDifference(msgspec.Struct, frozen=True):
    """Distance of two paths, in space and in time."""

    rms_m: float
    """Distance of each point of a path to the nearest one of the other, the larger one of both directions."""
    max_m: float
    same_time_rms_m: float
    """Distance at the same time since the begin of each phase: a phase begins when all members have ended the
    one before, in no two runs at the same instant."""
    phases: tuple[PhaseDifference, ...]


class VehicleRun(NamedTuple):
    """One run of a vehicle."""

    track: VehicleTrack
    phases: Mapping[str, float]
    """Begin of each phase of its mission, in their order, since the command."""


def difference(one: VehicleRun, other: VehicleRun) -> tuple[PathDifference, Floats, Floats] | None:
    """The difference, instants of the first path, and its distance to the second one at each.

    None: a path is missing, or the runs have no common phase. Units: seconds and metres.
    """
    if not len(one.track.t_s) or not len(other.track.t_s):
        return None
    phases, apart_m = _by_phase(one, other)
    if not len(apart_m):
        return None
    times_s = axis(0.0, float(one.track.t_s[-1]))
    here = resample(one.track, times_s)
    there = resample(other.track, axis(0.0, float(other.track.t_s[-1])))
    known_here, known_there = np.isfinite(here[:, 0]), np.isfinite(there[:, 0])
    if not known_here.any() or not known_there.any():
        return None
    to_other = np.full(len(times_s), np.nan)
    to_other[known_here] = _nearest(here[known_here], there[known_there])
    to_one = _nearest(there[known_there], here[known_here])
    forth, back = to_other[known_here], to_one
    found = PathDifference(
        max(_rms(forth), _rms(back)), float(max(forth.max(), back.max())), _rms(apart_m), phases
    )
    return found, times_s, to_other


def _by_phase(one: VehicleRun, other: VehicleRun) -> tuple[tuple[PhaseDifference, ...], Floats]:
    """Difference in each common phase, and all distances at the same time since its begin."""
    common = [phase for phase in one.phases if phase in other.phases]
    phases, distances = [], [np.empty(0)]
    for number, phase in enumerate(common):
        begin_s, began_s = one.phases[phase], other.phases[phase]
        last = number + 1 == len(common)
        ends_s = [
            (float(run.track.t_s[-1]) if last else run.phases[common[number + 1]]) - run.phases[phase]
            for run in (one, other)
        ]
        # as long as both runs were in the phase
        times_s = axis(0.0, min(ends_s))
        apart_m = np.linalg.norm(
            resample(one.track, begin_s + times_s) - resample(other.track, began_s + times_s), axis=1
        )
        known_m = apart_m[np.isfinite(apart_m)]
        if len(known_m):
            phases.append(PhaseDifference(phase, begin_s, began_s - begin_s, _rms(known_m)))
            distances.append(known_m)
    return tuple(phases), np.concatenate(distances)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _nearest(points: Floats, path: Floats) -> Floats:
    """Distance of each point to the nearest one of a path. Shapes: (N, 3), (M, 3) → (N,)."""
    return np.array([np.linalg.norm(path - point, axis=1).min() for point in points])
