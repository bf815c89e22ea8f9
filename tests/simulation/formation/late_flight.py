"""Vehicles whose nodes have too little processor time, so that each turn of an event loop takes long."""

import math
import random
from collections.abc import Collection

from tests.simulation.formation.flight import Flight, Vehicle

from swarmd.sim.core.simulation import SimulationOutput
from swarmware.geometry.world import World
from swarmware.types.vehicle import Pose, Setpoint

TURN_S = 0.2
"""Median of the time between two steps of the navigator, with 32 nodes on two cores."""
SPREAD = 0.5
"""Standard deviation of its logarithm: one turn of ten takes 0.4 s, one of a hundred 0.65 s."""
LONGEST_S = 2.0
PERIOD_NS = 50_000_000


class LateVehicle(Vehicle):
    """One platform whose services share an event loop, so that values are read in the same turn or a turn
    later."""

    def slow_down(self, turn_s: float, seed: int) -> None:
        self._turns = random.Random(f"turns {seed} {self.name}")
        self._turn_s = turn_s
        self._turn_ns = self._late_ns = 0
        self._sample: SimulationOutput | None = None
        self._setpoint = Setpoint(0.0)
        self._received: list[tuple[str, Pose, int]] = []

    def run(self, now_ns: int) -> None:
        if now_ns < self._turn_ns:
            return
        for name, pose, stamp_ns in self._received:
            super().receive(name, pose, stamp_ns)
        self._received.clear()
        services = [self._drive, self._sense, self._advance]
        self._turns.shuffle(services)
        for service in services:
            service(now_ns)
        step = self.navigator.step(now_ns, self._late_ns)
        self.told = step.pose
        self._setpoint = step.setpoint
        self.status = step.status or self.status
        if self.told is not None:
            self._radio.send(self.name, Pose.unpack(self.told.pack()), now_ns)
        turn_s = min(self._turn_s * math.exp(self._turns.gauss(0.0, SPREAD)), LONGEST_S)
        self._late_ns = max(0, round(turn_s * 1e9) - PERIOD_NS)
        self._turn_ns = now_ns + max(round(turn_s * 1e9), PERIOD_NS)

    def receive(self, name: str, pose: Pose, stamp_ns: int) -> None:
        self._received.append((name, pose, stamp_ns))

    def _drive(self, now_ns: int) -> None:
        self.simulation.on_command(self._setpoint, now_ns)

    def _advance(self, now_ns: int) -> None:
        self._sample = self.simulation.advance(now_ns)
        if self._sample is not None:
            self.truth = self._sample.truth
            self.collisions += self._sample.collisions

    def _sense(self, now_ns: int) -> None:
        if self._sample is not None:
            self.measure(self._sample)


class LateFlight(Flight):
    """The mission of some of the vehicles, with turns of this length from the take-off on."""

    def __init__(self, nodes: int, seed: int, names: Collection[str], turn_s: float = TURN_S) -> None:
        self._names = names
        self._turn_s = turn_s
        super().__init__(nodes, seed)

    def takes_part(self, kind: str, number: int) -> bool:
        return f"{kind}{number}" in self._names

    def vehicle(self, name: str, kind: str, number: int, where: World, seed: int) -> Vehicle:
        made = LateVehicle(name, kind, number, where, seed, self.radio)
        made.slow_down(self._turn_s, seed)
        return made
