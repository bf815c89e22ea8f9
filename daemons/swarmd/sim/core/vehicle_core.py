"""The simulation's core, which schedules the simulation, the reading of inputs, and publications."""

import msgspec

from swarmd.sim.config import Config
from swarmd.sim.core.simulation import Command, Simulation, SimulationOutput
from swarmware.runtime.core import AT_ONCE
from swarmware.types.chassis import ChassisOrder, ChassisReport
from swarmware.types.vehicle import Pose


class ReadBoards(msgspec.Struct, frozen=True):
    """Action: read the command, then call `on_boards_read`."""

    neighbours: bool
    """True to also read the poses of near platforms, because a collision check is due."""


class PublishOutput(msgspec.Struct, frozen=True, gc=False):
    """Action: publish the outputs of the simulation, stamped with their instant."""

    output: SimulationOutput


class PublishReport(msgspec.Struct, frozen=True):
    """Action: publish the report of the chassis after an order to it."""

    report: ChassisReport


Action = ReadBoards | PublishOutput | PublishReport


class VehicleCore:
    """Runs the simulation of one vehicle at the instants of its sensors."""

    def __init__(self, config: Config, simulation: Simulation) -> None:
        self._simulation = simulation
        self._contacts_ns = round(1e9 / config.contacts_hz)
        self._next_contacts_ns = AT_ONCE

    def on_command(self, command: Command, stamp_ns: int, now_ns: int) -> list[Action]:
        """Takes a command of the driver, a set-point or outputs of a flight controller."""
        self._simulation.on_command(command, stamp_ns)
        return []

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int, now_ns: int) -> list[Action]:
        """Takes the pose of another platform, stamped in the own clock."""
        self._simulation.on_neighbour(platform, pose, stamp_ns)
        return []

    def is_clear(self, platform: str, now_ns: int) -> bool:
        """True if the pose of a platform need not be read, because it is too far away for a contact."""
        return self._simulation.is_clear(platform, now_ns)

    def on_order(self, order: ChassisOrder, now_ns: int) -> list[Action]:
        """Executes or refuses an order to the chassis, and publishes the report that answers the order."""
        return [PublishReport(self._simulation.on_order(order))]

    def on_timer(self, now_ns: int) -> list[Action]:
        """Requests the inputs of the due sample."""
        neighbours = now_ns >= self._next_contacts_ns
        # rarer than the samples, since poses of others cost a read each
        if neighbours:
            self._next_contacts_ns = now_ns + self._contacts_ns
        return [ReadBoards(neighbours)]

    def on_boards_read(self, now_ns: int) -> list[Action]:
        """Simulates all samples up to now."""
        output = self._simulation.advance(now_ns)
        return [] if output is None else [PublishOutput(output)]

    def deadline_ns(self) -> int | None:
        """Instant of the next sample."""
        due_ns = self._simulation.deadline_ns()
        return AT_ONCE if due_ns is None else due_ns
