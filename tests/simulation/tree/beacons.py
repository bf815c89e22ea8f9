"""Structures in beacons, and questions for them, between real cores in virtual time: bytes as on the wire."""

import random
from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, Beacon
from swarmd.broker.core.boards.structure_broadcasts import StructureBroadcasts
from swarmd.tree.core.action import Action
from swarmd.tree.core.tree import SwarmTree
from swarmware.model.names import hardware_id
from swarmware.testing.virtual import VirtualTime
from swarmware.types.net import StructureBroadcast, TreePlan

CHANGING_S: Final = 0.2
"""Period of beacons while links change, as `CHANGING_HZ`."""
ROOM: Final = BODY_LIMIT // 2
"""What the other sections leave."""


class Station:
    """The broker of a node, as far as it has to do with structures."""

    def __init__(self, tree: SwarmTree) -> None:
        self.tree = tree
        self.name = str(tree.address)
        self.hw = hardware_id(self.name)
        self.broadcasts = StructureBroadcasts(self.hw)
        self.needs: tuple[str, ...] = ()
        self.is_waiting = False
        """A beacon is scheduled."""
        self.meets = False
        """That one answers the session of a new neighbour."""

    def take_plan(self) -> list[StructureBroadcast]:
        """Structures that the tree needs from now on, and that were received before."""
        tree = self.tree
        if not tree.plan_changed():
            return []
        self.needs = tuple(tree.replicas.needs())
        plan = TreePlan(tree.local.version, (), (), 0, tree.broadcast(), self.needs)
        return self.broadcasts.set_plan(plan)


class BeaconAir:
    """Carries the parts of beacons that concern structures to whoever is near, if they are not lost."""

    def __init__(
        self,
        time: VirtualTime,
        chance: random.Random,
        near: Callable[[str], Iterable[str]],
        feed: Callable[[str, list[Action]], None],
        *,
        loss: float = 0.0,
        count: Callable[[str, list[str], int, int], None] = lambda sender, receivers, size, data: None,
    ) -> None:
        """`near`: who receives the beacons of a node; `feed`: carries out what its tree wants then; `count`:
        gets of a beacon sender, receivers, bytes of the parts, and bytes of the structure in them."""
        self._time = time
        self._chance = chance
        self._near = near
        self._feed = feed
        self._loss = loss
        self._count = count
        self._stations: dict[str, Station] = {}

    def join(self, tree: SwarmTree) -> None:
        """A node, or its tree after a restart: the broker goes on."""
        station = self._stations.get(str(tree.address))
        if station is None:
            station = self._stations[str(tree.address)] = Station(tree)
        station.tree = tree
        self.on_settled(station.name)

    def leave(self, name: str) -> None:
        self._stations.pop(name, None)

    def on_settled(self, name: str) -> None:
        """The tree of a node has done its work: its plan may have changed."""
        station = self._stations.get(name)
        if station is not None:
            for found in station.take_plan():
                self._time.after(0.0, partial(self._give, station, found))
            self._schedule(station)

    def meet(self, *names: str) -> None:
        """Nodes answer each other's sessions for the first time: each in its next beacon."""
        for name in names:
            station = self._stations.get(name)
            if station is not None:
                station.meets = True
                self._schedule(station)

    def _give(self, station: Station, found: StructureBroadcast) -> None:
        self._feed(station.name, station.tree.on_broadcast(found, self._time.now_ns))

    def _schedule(self, station: Station) -> None:
        # beacons without any of these parts are left out: they cost no byte more than before
        if not station.is_waiting and (station.needs or self._is_due(station)):
            station.is_waiting = True
            self._time.after(CHANGING_S * self._chance.random(), partial(self._send, station))

    def _is_due(self, station: Station) -> bool:
        return station.meets or station.broadcasts.is_due(self._time.now_ns)

    def _send(self, station: Station) -> None:
        station.is_waiting = False
        if self._stations.get(station.name) is not station:
            return
        near = [name for name in self._near(station.name) if name in self._stations]
        if station.meets:
            station.broadcasts.offer()
        station.meets = False
        parts = station.broadcasts.compose(self._time.now_ns, ROOM, has_neighbours=bool(near))
        if parts.bytes:
            data = codec.encode(Beacon(structure=parts.structure, structure_questions=parts.questions))
            size = len(data) - 1
            assert size == parts.bytes <= ROOM
            receivers = [name for name in near if self._chance.random() >= self._loss]
            structure = 0 if parts.structure is None else len(parts.structure.data)
            self._count(station.name, receivers, size, structure)
            beacon = codec.decode(data)
            for name in receivers:
                self._receive(self._stations[name], station, beacon)
        if station.needs or self._is_due(station):
            station.is_waiting = True
            self._time.after(CHANGING_S, partial(self._send, station))

    def _receive(self, station: Station, sender: Station, beacon: Beacon) -> None:
        now_ns = self._time.now_ns
        found = station.broadcasts.on_beacon(sender.hw, sender.name, beacon, now_ns)
        if found is not None:
            self._give(station, found)
        self._schedule(station)
