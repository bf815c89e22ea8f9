"""Classes of the built-in blocks and of the blocks in installed packages, by type of block."""

import logging
from collections.abc import Mapping
from typing import Final

from swarmd.mission.blocks.formation import FormationBlock
from swarmd.mission.blocks.motions import (
    ArmBlock,
    DisarmBlock,
    GotoBlock,
    HoldBlock,
    LandBlock,
    ReturnBlock,
    TakeoffBlock,
    WaypointsBlock,
)
from swarmd.mission.blocks.requests import (
    RequestBlock,
    SetResourceBlock,
    StartModuleBlock,
    StopModuleBlock,
    UserBreakpointBlock,
)
from swarmd.mission.blocks.sensor import WaitForResourceBlock, WaitForSensorBlock
from swarmware.mission.installed import InstalledBlocks, installed_blocks
from swarmware.mission.plugin import FunctionalBlock

log = logging.getLogger("swarm.mission")

BUILT_IN: Final[tuple[type, ...]] = (
    ArmBlock,
    DisarmBlock,
    TakeoffBlock,
    LandBlock,
    GotoBlock,
    WaypointsBlock,
    ReturnBlock,
    FormationBlock,
    HoldBlock,
    WaitForSensorBlock,
    WaitForResourceBlock,
    RequestBlock,
    SetResourceBlock,
    StartModuleBlock,
    StopModuleBlock,
    UserBreakpointBlock,
)


class Plugins:
    """Creates blocks by the name of their type."""

    def __init__(self, blocks: InstalledBlocks) -> None:
        own = {cls.spec.name: cls for cls in BUILT_IN}  # type: ignore[attr-defined]  # each has a spec
        self._classes: Mapping[str, type] = {**blocks.classes, **own}
        self.catalogue = blocks.catalogue

    def make(self, name: str) -> FunctionalBlock:
        """Create a block of this type."""
        block: FunctionalBlock = self._classes[name]()
        return block


def installed() -> Plugins:
    """All block classes that are installed here; an unusable one of a package is logged and left out."""
    blocks = installed_blocks()
    for reason in blocks.unusable:
        log.error("block of a package is not available: %s", reason)
    return Plugins(blocks)
