"""The interface of functional blocks, for packages with their own (entry-point group `swarmware.blocks`).

    class TakePhoto:
        spec = BlockType("TakePhoto", "Takes a picture.", Photo, timeout_s=5.0, errors=("no_camera",))

        async def run(self, context: BlockContext) -> None:
            camera = await context.module.request("sys/camera/shoot", …)

A return is the outcome `ok`, `BlockError(kind, text)` the outcome `error:kind`. A cancellation raises
CancelledError in `run`: clean up in `finally`.
"""

from typing import Any, ClassVar, Protocol

from swarmware.errors import SwarmError
from swarmware.mission.catalogue import BlockType


class BlockError(SwarmError):
    """A block has failed; the kind selects the successor."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class BlockContext(Protocol):
    """Interface that a running block gets."""

    @property
    def module(self) -> Any:
        """The mission daemon's `swarmware.module.Module`: boards, messages, requests."""
        ...

    @property
    def block_id(self) -> str:
        """Name of the block in its mission."""
        ...

    @property
    def params(self) -> Any:
        """Its parameters, an instance of `spec.params`."""
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
