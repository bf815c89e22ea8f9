"""The catalogue of the block types that are installed on this computer."""

from swarmware.errors import MissionError
from swarmware.mission.catalogue import BLOCKS, BlockType, Catalogue
from swarmware.model.plugins import BLOCK_GROUP, entry_points


def installed() -> Catalogue:
    """The built-in blocks and those of installed packages.

    Raises: MissionError when a package's entry point is not a block, or takes a name that is in use.
    """
    foreign: list[BlockType] = []
    for point in entry_points(BLOCK_GROUP):
        spec = getattr(point.load(), "spec", None)
        if not isinstance(spec, BlockType):
            raise MissionError(
                f"entry point {BLOCK_GROUP}:{point.name}: expected a class with `spec: BlockType`"
            )
        foreign.append(spec)
    return Catalogue((*BLOCKS, *foreign))
