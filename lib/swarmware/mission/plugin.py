"""The interface of functional blocks, for packages with their own (entry-point group `swarmware.blocks`).

    class TakePhoto:
        spec = BlockType("TakePhoto", "Takes a picture.", Photo, timeout_s=5.0, errors=("no_camera",))

        async def run(self, context: BlockContext) -> None:
            camera = await context.module.request("sys/camera/shoot", …)

A return is the outcome `ok`, `BlockError(kind, text)` the outcome `error:kind`. A cancellation raises
CancelledError in `run`: clean up in `finally`. `swarmctl new block` makes a package with a block and a test.
"""

from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from swarmware.errors import SwarmError
from swarmware.mission.catalogue import BlockType
from swarmware.types.navigation import NavStatus
from swarmware.types.vehicle import Pose


class BlockError(SwarmError):
    """A block has failed; the kind selects the successor."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class BlockVehicle(Protocol):
    """The vehicle of a running block; a block that moves it has `motion=True` in its type."""

    @property
    def flies(self) -> bool:
        """Whether the vehicle can fly."""
        ...

    @property
    def landed(self) -> bool:
        """Whether the vehicle is on the ground, as last received."""
        ...

    @property
    def pose(self) -> Pose:
        """The position, as last received.

        Raises: BlockError no_position when none was received.
        """
        ...

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
        """Move to a position and wait until it is reached; a cancellation commands hold.

        Raises: BlockError with a kind of MOTION_ERRORS.
        """
        ...


class BlockContext(Protocol):
    """Interface of the mission daemon to a running block."""

    @property
    def module(self) -> Any:
        """The mission daemon's `swarmware.module.Module`: boards, messages, requests."""
        ...

    @property
    def vehicle(self) -> BlockVehicle:
        """The vehicle of this platform.

        Raises: BlockError no_vehicle when it has none.
        """
        ...

    @property
    def block_id(self) -> str:
        """Name of the block in its mission."""
        ...

    @property
    def params(self) -> Any:
        """Parameters of the block, an instance of `spec.params`."""
        ...

    def report(self, ratio: float, text: str) -> None:
        """Report the progress, from 0 to 1, with a text for operators."""
        ...


class FunctionalBlock(Protocol):
    """A functional block; one object per run."""

    spec: ClassVar[BlockType]

    async def run(self, context: BlockContext) -> None:
        """Execute the block.

        Raises: BlockError.
        """
        ...
