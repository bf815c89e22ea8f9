"""Structures from the beacons of neighbours, until the version that they advertise is known to be theirs."""

from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.core.structure.structure import StructureEncoding
from swarmware.types.net import StructureBroadcast
from swarmware.types.tree_exchange import StructureReply


class ReceivedBroadcasts:
    """The newest structure of each node that came in a beacon.

    Structures and versions come to the tree on different ways: one of them may be the older one.
    """

    def __init__(self, limit: int) -> None:
        """`limit`: maximum number of nodes; the oldest structure is dropped."""
        self._limit = limit
        self._newest: dict[str, StructureBroadcast] = {}

    def __len__(self) -> int:
        return len(self._newest)

    def put(self, broadcast: StructureBroadcast) -> None:
        """A structure was received."""
        self._newest.pop(broadcast.node, None)
        if len(self._newest) >= self._limit:
            del self._newest[next(iter(self._newest))]
        self._newest[broadcast.node] = broadcast

    def take(self, replica: Replica) -> StructureReply | None:
        """Remove the structure of a node, if it has the version that its beacons advertise."""
        found = self._newest.get(replica.name)
        if found is None or not replica.structure.is_of_advertised(found.epoch, found.digest):
            return None
        del self._newest[replica.name]
        return StructureReply(found.epoch, found.digest, StructureEncoding.TEMPLATE, found.base, found.data)

    def forget(self, node: str) -> None:
        """Remove the structure of a node that is not known any more."""
        self._newest.pop(node, None)
