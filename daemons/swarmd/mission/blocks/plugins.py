"""Classes of blocks by type: the built-in ones, and those of installed packages."""

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
)
from swarmware.mission.catalogue import BLOCKS, BlockType, Catalogue
from swarmware.mission.plugin import FunctionalBlock
from swarmware.model.plugins import BLOCK_GROUP, entry_points

BUILT_IN: Final[tuple[type, ...]] = (
    ArmBlock,
    DisarmBlock,
    TakeoffBlock,
    LandBlock,
    GotoBlock,
    ReturnBlock,
    FormationBlock,
    HoldBlock,
)


class Plugins:
    """Creates blocks by the name of their type."""

    def __init__(self, classes: Mapping[str, type], foreign: tuple[BlockType, ...]) -> None:
        self._classes = dict(classes)
        self.catalogue = Catalogue((*BLOCKS, *foreign))

    def make(self, name: str) -> FunctionalBlock:
        """Create a block of this type."""
        block: FunctionalBlock = self._classes[name]()
        return block


def installed() -> Plugins:
    """All block classes that are installed here.

    Raises: MissionError when a package uses a name that is taken.
    """
    classes = {cls.spec.name: cls for cls in BUILT_IN}  # type: ignore[attr-defined]  # each has a spec
    foreign: list[BlockType] = []
    for point in entry_points(BLOCK_GROUP):
        cls = point.load()
        foreign.append(cls.spec)
        classes.setdefault(cls.spec.name, cls)
    return Plugins(classes, tuple(foreign))
