"""Figures from recorded data: pure functions on arrays.

Shapes: T instants, P platforms. Units: seconds, metres.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE_HZ: Final = 20.0
"""Common time axis of all poses: the navigators' own rate."""
GAP_S: Final = 1.0
"""Longest hole in a recording over which a position is interpolated."""
SAME_CONTACT_S: Final = 2.0
"""Contacts of the same two bodies within this time are one collision."""


class TimeSeries(msgspec.Struct, frozen=True):
    """One quantity over time."""

    t_s: Floats
    value: Floats


class VehicleTrack(msgspec.Struct, frozen=True):
    """True path of a vehicle."""

    platform: str
    t_s: Floats
    """True time, ascending. Shape (T,)."""
    xyz_m: Floats
    """True positions. Shape (T, 3)."""
    yaw_rad: Floats
    """Heading, counter-clockwise from east. Shape (T,)."""


class Contact(msgspec.Struct, frozen=True, order=True):
    """An instant at which two bodies touched."""

    t_s: float
    one: str
    other: str


class Separation(msgspec.Struct, frozen=True):
    """The two vehicles with the minimum distance."""

    distance_m: float
    """Minimum distance of their centres."""
    one: str = ""
    other: str = ""
    t_s: float = 0.0


class Spread(msgspec.Struct, frozen=True):
    """A distribution in four numbers; all None without values."""

    p50: float | None = None
    p95: float | None = None
    p99: float | None = None
    max: float | None = None
    mean: float | None = None


def spread(values: Sequence[float] | Floats) -> Spread:
    """Percentiles, maximum and mean."""
    if len(values) == 0:
        return Spread()
    data = np.asarray(values, dtype=np.float64)
    p50, p95, p99 = (float(p) for p in np.percentile(data, (50, 95, 99)))
    return Spread(p50, p95, p99, float(data.max()), float(data.mean()))


def axis(start_s: float, end_s: float, rate_hz: float = RATE_HZ) -> Floats:
    """Common instants from start to end."""
    return start_s + np.arange(int(max(0.0, end_s - start_s) * rate_hz) + 1) / rate_hz


def resample(track: VehicleTrack, times_s: Floats, gap_s: float = GAP_S) -> Floats:
    """Positions at these instants, straight lines between samples; NaN outside and in holes.

    Shapes: (T,) → (T, 3).
    """
    out = np.full((len(times_s), 3), np.nan)
    if len(track.t_s) == 0:
        return out
    inside = _covered(track.t_s, times_s, gap_s)
    for i in range(3):
        out[inside, i] = np.interp(times_s[inside], track.t_s, track.xyz_m[:, i])
    return out


def resample_yaw(track: VehicleTrack, times_s: Floats, gap_s: float = GAP_S) -> Floats:
    """Headings at these instants, the short way round; NaN outside and in holes. Shapes: (T,) → (T,)."""
    out = np.full(len(times_s), np.nan)
    if len(track.t_s) == 0:
        return out
    inside = _covered(track.t_s, times_s, gap_s)
    # unwrapped: between 179° and -179° the interpolation would turn the long way
    out[inside] = np.interp(times_s[inside], track.t_s, np.unwrap(track.yaw_rad))
    return out


def _covered(samples_s: Floats, times_s: Floats, gap_s: float) -> NDArray[np.bool_]:
    after = np.searchsorted(samples_s, times_s, side="left")
    exact = np.zeros(len(times_s), dtype=np.bool_)
    within = after < len(samples_s)
    # a sample itself is covered even at the edge of a hole
    exact[within] = samples_s[after[within]] == times_s[within]
    between = within & (after > 0)
    hole = np.full(len(times_s), np.inf)
    hole[between] = samples_s[after[between]] - samples_s[after[between] - 1]
    return exact | (hole <= gap_s)


def closest(positions: Mapping[str, Floats], times_s: Floats) -> Separation | None:
    """Minimum distance between any two vehicles, or None without simultaneous positions."""
    best: Separation | None = None
    for one, other in combinations(sorted(positions), 2):
        distance = np.linalg.norm(positions[one] - positions[other], axis=1)
        if not np.isfinite(distance).any():
            continue
        at = int(np.nanargmin(distance))
        if best is None or distance[at] < best.distance_m:
            best = Separation(float(distance[at]), one, other, float(times_s[at]))
    return best


def touches(positions: Mapping[str, Floats], radii_m: Mapping[str, float], times_s: Floats) -> list[Contact]:
    """First instants at which two vehicles overlapped: spheres of their radii."""
    found = []
    for one, other in combinations(sorted(positions), 2):
        distance = np.linalg.norm(positions[one] - positions[other], axis=1)
        # an unknown distance is not an overlap
        inside = np.nan_to_num(distance, nan=np.inf) < radii_m[one] + radii_m[other]
        begins = np.flatnonzero(inside & ~np.concatenate(([False], inside[:-1])))
        found += [Contact(float(times_s[i]), one, other) for i in begins]
    return sorted(found)


def collisions(contacts: Iterable[Contact]) -> int:
    """Number of collisions: both sides report one, and a sliding contact is reported repeatedly."""
    last: dict[frozenset[str], float] = {}
    count = 0
    for contact in sorted(contacts):
        pair = frozenset((contact.one, contact.other))
        if contact.t_s - last.get(pair, -np.inf) > SAME_CONTACT_S:
            count += 1
        # also for a contact that is not counted, as long sliding is a single collision
        last[pair] = contact.t_s
    return count


def within(times_s: Floats, spans: Iterable[tuple[float, float]]) -> NDArray[np.bool_]:
    """Whether each instant lies in any of the spans, ends included. Shapes: (T,) → (T,)."""
    inside = np.zeros(len(times_s), dtype=np.bool_)
    for start_s, end_s in spans:
        inside |= (times_s >= start_s) & (times_s <= end_s)
    return inside


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Start and end index of each run of true values. Shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
