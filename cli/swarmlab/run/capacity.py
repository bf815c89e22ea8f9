"""Checks whether this computer can run the nodes of a lab, by measuring the first ones, then all."""

import asyncio
import os
from collections.abc import Mapping
from typing import Final

from swarmctl.session.labs import LabState
from swarmlab.measure import host, load
from swarmlab.measure.host import HostInfo
from swarmlab.measure.load import Usage
from swarmware.errors import SwarmError

FIRST: Final = 8
"""Nodes whose processor time is measured before the others are started."""
CERTAIN_PER_CORE: Final = 8
"""Nodes per core up to which no measurement is needed; sixteen used about 1.5 of two cores."""
SAMPLE_S: Final = 2.0
SAMPLES: Final = 5
"""Samples until nodes at rest fit: in the first seconds, when they meet, they take twice as much."""
FULL: Final = 0.93
"""Share of all cores above which the event loops of nodes are late, and their beacons slow down."""


def needs_measurement(nodes: int, cores: int) -> bool:
    """Whether the computer may be too slow for this number of nodes."""
    return nodes > CERTAIN_PER_CORE * cores


def refusal(nodes: int, measured: HostInfo, first: int) -> str:
    """Reason why the computer cannot run this number of nodes, or "" if it can.

    The cost of a node grows with its neighbours, so the cost of the first nodes is a lower bound.
    """
    assert measured.nodes_percent is not None
    per_node = measured.nodes_percent / first
    limit = measured.cores * 100
    if nodes * per_node <= limit:
        return ""
    carried = max(1, int(limit / per_node))
    return (
        f"{nodes} nodes are too many for this computer: the first {first} use "
        f"{per_node:.1f} % of a core each at rest, {measured.summary()}; "
        f"expected at most {carried} nodes, or more cores"
    )


def shortage(nodes: int, measured: HostInfo) -> str:
    """Warning when all nodes run and the processor is short for them, or "" if it is not."""
    assert measured.nodes_percent is not None
    if measured.nodes_percent <= FULL * measured.cores * 100:
        return ""
    return (
        f"the processor is short for {nodes} nodes, {measured.summary()}: beacons slow down, and vehicles "
        "steer less often; figures of time are this computer's"
    )


class Capacity:
    """Measures the nodes of a lab that is being started."""

    def __init__(self, nodes: int) -> None:
        self._nodes = nodes
        self._before = host.describe()

    @property
    def first(self) -> int:
        """Number of nodes to start before the measurement; all when none is needed."""
        return FIRST if needs_measurement(self._nodes, os.cpu_count() or 1) else self._nodes

    def describe(self) -> str:
        """Present load of the computer, for errors that it may have caused."""
        return f"{self._before.summary()}, {os.getloadavg()[0]:.1f} now"

    async def check_first(self, lab: LabState) -> None:
        """Measures the first nodes at rest, before the others are started.

        Raises: SwarmError with their use and the possible number of nodes.
        """
        reason = ""
        for _ in range(SAMPLES):
            # one good sample is enough, as nodes take more only while they meet
            if not (reason := refusal(self._nodes, await self._sample(lab), self.first)):
                return
        raise SwarmError(f"lab {lab.name}: {reason}")

    async def check_all(self, lab: LabState) -> str:
        """Measures all nodes, unless that is not needed; a warning when the processor is short for them."""
        if not needs_measurement(self._nodes, self._before.cores):
            return ""
        return shortage(self._nodes, await self._sample(lab))

    async def _sample(self, lab: LabState) -> HostInfo:
        busy, used = host.busy(), load.usage(lab)
        await asyncio.sleep(SAMPLE_S)  # the sampling interval
        return host.shares(self._before, busy, host.busy(), _percents(used, load.usage(lab)))


def _percents(before: Mapping[str, Usage], after: Mapping[str, Usage]) -> list[float]:
    return [load.percent(before[platform], after[platform]) for platform in before]
