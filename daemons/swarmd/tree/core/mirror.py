"""Duplicate check of values for a mirror."""

from swarmware.model.frame import FrameKind
from swarmware.types.tree import TreeItem


def is_newer(item: TreeItem, sequence: int, stamp_ns: int) -> bool:
    """Whether an item is newer than the newest one in the mirror, of this sequence and stamp.

    A notification is sent again when only its acknowledgement was lost. A board shows what came last;
    a smaller sequence with a later stamp is from a restart of its owner.
    """
    return item.kind == FrameKind.BOARD or item.sequence > sequence or item.stamp_ns > stamp_ns
