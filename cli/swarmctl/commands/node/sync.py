"""Whether the data of nodes are synchronised, by the digests of their trees."""

import asyncio
from enum import StrEnum

import msgspec

from swarmctl.resources.fanout import read_boards
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.types.tree import TreeList, TreeListing, TreePlatform
from swarmware.types.tree_exchange import TreeStats


class SyncVerdict(StrEnum):
    """Whether the data of a node are synchronised, and if not, what is missing."""

    SYNCED = "synced"
    """The node has the structures of the platforms that it follows, and they hold its subscriptions."""
    STRUCTURE = "structure"
    """The node's copy of the structure of another platform differs."""
    VALUES = "values"
    """Another platform does not hold its subscription yet: values are missing."""
    BEHIND = "behind"
    """The joined node has a different structure of it."""


class NodeSync(msgspec.Struct, frozen=True):
    """Synchronisation of one node with the swarm, in both directions."""

    verdict: SyncVerdict
    followed: int
    """Reachable platforms that the node follows: neighbours, and those whose data its applications read."""
    structures: int
    """Number of followed platforms whose structure digest matches the node's copy."""
    subscriptions: int
    """Number of followed platforms whose copy of the node's subscription matches by digest."""

    def __str__(self) -> str:
        """synced 15/15 | structure 14/15 | values 14/15 | behind."""
        match self.verdict:
            case SyncVerdict.BEHIND:
                return str(self.verdict)
            case SyncVerdict.STRUCTURE:
                count = self.structures
            case SyncVerdict.VALUES | SyncVerdict.SYNCED:
                count = self.subscriptions
        return f"{self.verdict} {count}/{self.followed}"


def node_sync(stats: TreeStats, replica: TreePlatform | None) -> NodeSync:
    """Synchronisation by the node's own counters and the joined node's replica of it (None: it has none)."""
    # first, since all that the joined node shows of this platform may be outdated
    if replica is not None and replica.followed and replica.digest != stats.digest:
        verdict = SyncVerdict.BEHIND
    elif stats.structures < stats.followed:
        verdict = SyncVerdict.STRUCTURE
    elif stats.subscriptions < stats.followed:
        verdict = SyncVerdict.VALUES
    else:
        verdict = SyncVerdict.SYNCED
    return NodeSync(verdict, stats.followed, stats.structures, stats.subscriptions)


async def synchronisation(session: Session, asked: list[str]) -> dict[str, NodeSync]:
    """Synchronisation of the platforms that answered."""
    (trees, _), replicas = await asyncio.gather(
        read_boards(session, asked, "tree/stats", TreeStats, fresh=True), _replicas(session)
    )
    return {name: node_sync(stats, replicas.get(name)) for name, stats in trees.items()}


async def _replicas(session: Session) -> dict[str, TreePlatform]:
    """What the joined node has of each tree, or none without a tree service."""
    nothing = TreeList(f"/{session.here}/none", 1)
    try:
        found = await session.ask(names.join(session.here, "sys/tree/list"), nothing, TreeListing)
    except SwarmError:
        return {}
    return {one.platform: one for one in found.platforms}
