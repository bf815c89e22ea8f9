"""What a moving swarm shows of its directory: pairs with a route, outages, stretch, bytes."""

from typing import Final, NamedTuple

import numpy as np
from tests.simulation.directory.swarm import Pairs, Swarm

LOOKS_HZ: Final = 4
"""All routes are followed this often."""
DELIVERY_MIN: Final = 0.2
"""A route counts when each of its links delivers this share: repetitions carry a frame over it."""


class FlightFigures(NamedTuple):
    """Figures of one flight."""

    routed_ratio: float
    """Share of the connected pairs whose route leads there, of all looks."""
    directory_bytes_s: float
    """Bytes about links and routes that a node sends, in the mean of the nodes."""
    directory_max_bytes_s: float
    """The same of the node that sends most."""
    beacon_bytes_s: float
    """All bytes that a node sends, with seal, UDP and IP: its pose and the names of others, too."""
    stretch: float
    """Expected transmissions of the routes, divided by the expected transmissions of the best paths."""
    outages_s: list[float]
    """How long connected pairs were without a route that leads there."""
    changes: int
    """Changes of routes, each of which was followed for a loop."""


class Outages:
    """Connected pairs without a route, from look to look."""

    def __init__(self, count: int) -> None:
        self._looks = np.zeros((count, count), dtype=np.int32)
        self.ended_s: list[float] = []

    def look(self, connected: Pairs, arrived: Pairs) -> None:
        """Notes which pairs have a route now; an outage that ends because its pair is
        parted is not a fault of the directory."""
        ended = self._looks[arrived & (self._looks > 0)]
        self.ended_s += [float(looks) / LOOKS_HZ for looks in ended]
        self._looks = np.where(connected & ~arrived, self._looks + 1, 0)

    def all_s(self) -> list[float]:
        """All outages, those that still last with their time so far."""
        return self.ended_s + [float(looks) / LOOKS_HZ for looks in self._looks[self._looks > 0]]


def fly(swarm: Swarm, warm_s: float, seconds: float) -> FlightFigures:
    """Moves a swarm that has just started; measures for `seconds` after the first `warm_s`.

    Raises: AssertionError when a changed route makes a loop.
    """
    count = len(swarm.names)
    outages = Outages(count)
    connected = arrived = 0
    stretches: list[float] = []
    changes = sent_bytes = 0
    for look in range(1, round((warm_s + seconds) * LOOKS_HZ) + 1):
        swarm.run_for(1 / LOOKS_HZ)
        if look == round(warm_s * LOOKS_HZ):
            changes = swarm.changes
            sent_bytes = sum(node.sent_bytes for node in swarm.brokers.values())
            for node in swarm.brokers.values():
                node.directory_bytes = 0
        if look > warm_s * LOOKS_HZ:
            routes = swarm.follow(DELIVERY_MIN)
            outages.look(routes.connected, routes.arrived)
            connected += int(routes.connected.sum())
            arrived += int(routes.arrived.sum())
            if look % LOOKS_HZ == 0:
                stretches.append(routes.stretch())
        swarm.move(1 / LOOKS_HZ)
    swarm.assert_published()
    directory_bytes = [node.directory_bytes for node in swarm.brokers.values()]
    sent_bytes = sum(node.sent_bytes for node in swarm.brokers.values()) - sent_bytes
    return FlightFigures(
        arrived / connected,
        sum(directory_bytes) / count / seconds,
        max(directory_bytes) / seconds,
        sent_bytes / count / seconds,
        float(np.mean(stretches)),
        outages.all_s(),
        swarm.changes - changes,
    )
