"""Traffic of a run from the brokers' counters: differences between two instants, and rates over time."""

from collections.abc import Sequence

import msgspec
import numpy as np

from swarmlab.measure.tracks import Floats, TimeSeries
from swarmware.types.traffic import Traffic

Counters = Sequence[tuple[float, Traffic]]
"""A broker's counters with their instants, in order."""


class TrafficTotals(msgspec.Struct, frozen=True):
    """Traffic of a node's broker in a time span."""

    sent_bytes: float = 0.0
    received_bytes: float = 0.0
    requests: float = 0.0
    notifications: float = 0.0
    lost_datagrams: float = 0.0


def between(counters: Counters, start_s: float, end_s: float) -> TrafficTotals:
    """Increase of the counters; between two reports it is interpolated linearly.

    A counter that decreases belongs to a restarted broker: the values are added over the restart.
    """
    if not counters:
        return TrafficTotals()
    t_s = np.array([at_s for at_s, _ in counters])
    grown = {}
    for name in TrafficTotals.__struct_fields__:
        values = _unwound(np.array([float(getattr(value, name)) for _, value in counters]))
        before, after = np.interp([start_s, end_s], t_s, values)
        grown[name] = float(after - before)
    return TrafficTotals(**grown)


def _unwound(values: Floats) -> Floats:
    """A counter without the resets to zero."""
    steps = np.diff(values, prepend=values[0])
    fallen = steps < 0
    # a counter that fell began at zero, so its whole value is growth
    steps[fallen] = values[fallen]
    result: Floats = values[0] + np.cumsum(steps)
    return result


def egress(counters: Counters) -> TimeSeries:
    """Sent kilobytes per second, at the middle of each pair of reports."""
    t_s = np.array([at_s for at_s, _ in counters])
    sent = _unwound(np.array([float(value.sent_bytes) for _, value in counters])) if counters else t_s
    if len(t_s) < 2:
        return TimeSeries(np.empty(0), np.empty(0))
    steps = np.diff(t_s)
    # two reports with one stamp have no rate
    good = steps > 0
    return TimeSeries(((t_s[1:] + t_s[:-1]) / 2)[good], np.diff(sent)[good] / steps[good] / 1000)
