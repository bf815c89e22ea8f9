"""A context for the test of a functional block: it records what the block does, without a node."""

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec

from swarmware.mission.catalogue import Params
from swarmware.mission.plugin import BlockError
from swarmware.types.navigation import NavState, NavStatus
from swarmware.types.vehicle import Pose


class RecordedVehicle:
    """A vehicle that is at each goal at once."""

    def __init__(self, pose: Pose, *, flies: bool = True, landed: bool = False) -> None:
        self.pose = pose
        self.flies = flies
        self.landed = landed
        self.visited: list[tuple[float, float, float]] = []
        """Positions in the order in which the block commanded them."""
        self.refuse: dict[int, BlockError] = {}
        """Errors with which a command ends, by its number from 0."""

    async def goto(
        self,
        x_m: float,
        y_m: float,
        z_m: float,
        *,
        speed_m_s: float = 1.5,
        yaw_rad: float | None = None,
        progress: Callable[[NavStatus], None] | None = None,
    ) -> None:
        """Record the position, and be there."""
        number = len(self.visited)
        if number in self.refuse:
            raise self.refuse[number]
        self.visited.append((x_m, y_m, z_m))
        self.pose = msgspec.structs.replace(self.pose, x_m=x_m, y_m=y_m, z_m=z_m)
        if progress is not None:
            progress(NavStatus(number + 1, NavState.ARRIVED))
        await asyncio.sleep(0)


class RecordedContext:
    """The context of one run of a block."""

    def __init__(self, params: Params, vehicle: RecordedVehicle | None = None, module: Any = None) -> None:
        self.params: Any = params
        self.module = module
        self.block_id = "block"
        self.reports: list[tuple[float, str]] = []
        """Progress that the block reported: ratio and text."""
        self._vehicle = vehicle

    @property
    def vehicle(self) -> RecordedVehicle:
        """The vehicle. Raises: BlockError no_vehicle without one."""
        if self._vehicle is None:
            raise BlockError("no_vehicle", "the test has no vehicle")
        return self._vehicle

    def report(self, ratio: float, text: str) -> None:
        """Record the progress of the block."""
        self.reports.append((ratio, text))
