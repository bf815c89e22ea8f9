"""Present cost of starting a daemon on this machine, as a measure for the restart of a killed daemon."""

import statistics
import time
from collections.abc import Mapping
from pathlib import Path

from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node

QUIET_S = 1.0
"""A killed daemon is back within this time on a machine that does nothing else."""
STARTS = 3.0
"""On a busy machine: within so many starts of a daemon."""


class Starts:
    """Starts of one daemon of a node of its own, measured beside what is tested."""

    def __init__(self, root: Path) -> None:
        self._config = make_node(root, "meter", services={"timesync": {}})
        self._took_s: list[float] = []

    async def measure(self) -> None:
        """One start more, up to READY."""
        began_s = time.monotonic()
        async with spawn(self._config, "timesync", forked=False):
            self._took_s.append(time.monotonic() - began_s)

    @property
    def slowest_s(self) -> float:
        """The longest of the starts."""
        return max(self._took_s)

    @property
    def limit_s(self) -> float:
        """Time that a killed daemon has to be back."""
        return max(QUIET_S, STARTS * self.slowest_s)

    def report(self, took_s: Mapping[str, float]) -> str:
        """The distribution, each daemon, and what they are judged by."""
        ordered = sorted(took_s.values())
        # the smallest measurement that 95 % do not exceed; of eleven, the largest
        p95_s = ordered[-(-95 * len(ordered) // 100) - 1]
        lines = [
            f"{name:<10} {value:.2f} s" for name, value in sorted(took_s.items(), key=lambda one: -one[1])
        ]
        return "\n".join(
            [
                f"back: p50 {statistics.median(ordered):.2f} s, p95 {p95_s:.2f} s, max {ordered[-1]:.2f} s;"
                f" limit {self.limit_s:.2f} s",
                f"starts of a daemon beside it: {min(self._took_s):.2f} to {max(self._took_s):.2f} s",
                *lines,
            ]
        )

    def late(self, took_s: Mapping[str, float]) -> list[str]:
        """Daemons that needed longer than they may."""
        return [name for name, value in took_s.items() if value >= self.limit_s]
