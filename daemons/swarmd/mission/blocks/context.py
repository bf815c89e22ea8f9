"""The interface that a running block gets."""

from collections.abc import Callable
from typing import Any

from swarmd.mission.questions import Questions
from swarmd.mission.vehicle import VehicleClient
from swarmware.mission.catalogue import BLOCKS, BlockType, Params
from swarmware.mission.plugin import BlockError
from swarmware.module.module import Module


class Context:
    """One run of one block."""

    def __init__(
        self,
        module: Module,
        vehicle: VehicleClient | None,
        block_id: str,
        params: Params,
        report: Callable[[float, str], None],
        questions: Questions | None = None,
    ) -> None:
        self.module = module
        self.block_id = block_id
        self.params: Any = params
        self._vehicle = vehicle
        self._report = report
        self._questions = questions

    @property
    def vehicle(self) -> VehicleClient:
        """The vehicle of this platform.

        Raises: BlockError when it has none.
        """
        if self._vehicle is None:
            raise BlockError("no_vehicle", f"{self.module.platform} is not a vehicle")
        return self._vehicle

    @property
    def is_armed(self) -> bool:
        """Whether this platform is a vehicle with armed motors."""
        return self._vehicle is not None and self._vehicle.armed

    @property
    def questions(self) -> Questions:
        """The questions to the operator."""
        assert self._questions is not None  # the runner gives them to every block
        return self._questions

    def report(self, ratio: float, text: str) -> None:
        """Report the progress of the block, from 0 to 1, with a text for operators."""
        self._report(ratio, f"{self.block_id}: {text}")


def spec(name: str) -> BlockType:
    """The type of a built-in block."""
    return next(block for block in BLOCKS if block.name == name)
