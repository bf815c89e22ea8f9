"""Whether this computer can run so many nodes: measured at the first ones, and when all are up."""

import asyncio
import os
from collections.abc import Mapping
from typing import Final

from swarmctl.labs import LabState
from swarmlab import host, load
from swarmlab.host import HostInfo
from swarmlab.load import Usage
from swarmware.errors import SwarmError

FIRST: Final = 8
"""Nodes whose processor time is measured before the others are started."""
CERTAIN_PER_CORE: Final = 8
"""Up to so many nodes for each core nothing is measured; sixteen used about 1.5 of two cores."""
SAMPLE_S: Final = 2.0
FULL: Final = 0.93
"""Share of all cores that the nodes may take: above it their event loops are late and links fall."""


def needs_a_look(nodes: int, cores: int) -> bool:
    """Whether it is not certain that the computer carries them."""
    return nodes > CERTAIN_PER_CORE * cores


def refusal(nodes: int, measured: HostInfo, first: int) -> str:
    """Why the computer does not carry so many nodes; empty when it may.

    A node costs more the more neighbours it has: what the first ones cost is a lower bound.
    """
    assert measured.nodes_percent is not None
    per_node = measured.nodes_percent / first
    limit = FULL * measured.cores * 100
    if nodes * per_node <= limit:
        return ""
    carried = max(1, int(limit / per_node))
    return (
        f"{nodes} nodes are too many for this computer: the {'first ' if first < nodes else ''}{first} use "
        f"{per_node:.1f} % of a core each, {measured.summary()}; "
        f"expected at most {carried} nodes, or more cores"
    )


class Capacity:
    """Measures the nodes of a lab that is being started.

    Raises: SwarmError when the processor is too slow for all of them.
    """

    def __init__(self, nodes: int) -> None:
        self._nodes = nodes
        self._before = host.describe()

    @property
    def first(self) -> int:
        """How many nodes to start before the first look; all, when none is needed."""
        return FIRST if needs_a_look(self._nodes, os.cpu_count() or 1) else self._nodes

    def describe(self) -> str:
        """The computer now, for an error that may come from it."""
        return f"{self._before.summary()}, {os.getloadavg()[0]:.1f} now"

    async def measure(self, lab: LabState, started: int) -> None:
        """Measures the nodes that run, for two seconds, where it is not certain that all can.

        Raises: SwarmError with what they use and how many would do.
        """
        if not needs_a_look(self._nodes, self._before.cores):
            return
        busy, used = host.busy(), load.usage(lab)
        await asyncio.sleep(SAMPLE_S)  # the sampling interval
        found = host.shares(self._before, busy, host.busy(), _percents(used, load.usage(lab)))
        if reason := refusal(self._nodes, found, started):
            raise SwarmError(f"lab {lab.name}: {reason}")


def _percents(before: Mapping[str, Usage], after: Mapping[str, Usage]) -> list[float]:
    return [load.percent(before[platform], after[platform]) for platform in before]
