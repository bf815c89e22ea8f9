"""Simulated clocks, and the errors of the nodes' clock conversions against them."""

from collections.abc import Iterable, Mapping

import msgspec

from swarmware.model.clock import Clock
from swarmware.types.time import TimeFunctions


class ClockTruth(msgspec.Struct, frozen=True):
    """True parameters of a node's simulated clock."""

    offset_s: float
    drift_ppm: float

    @property
    def clock(self) -> Clock:
        """A clock with these parameters."""
        return Clock(self.offset_s, self.drift_ppm)


def errors_us(
    platform: str, functions: Iterable[TimeFunctions], clocks: Mapping[str, ClockTruth]
) -> list[float]:
    """Errors of one node's conversions, each at the instant at which they were published.

    Units: µs, estimated minus true reading of the other clock.
    """
    here = clocks[platform].clock
    found = []
    for published in functions:
        mono_ns = here.to_mono_ns(published.stamp_ns)
        for function in published.functions:
            truth = clocks.get(function.platform)
            # without a sample the function is not an estimate yet
            if truth is not None and function.samples:
                true_ns = truth.clock.from_mono_ns(mono_ns)
                found.append((function.to_remote(published.stamp_ns) - true_ns) / 1000)
    return found
