"""SYNC of `swarmctl node ls`: by the counters of the node, and by what the joined node has of it."""

import pytest

from swarmctl.commands.node.sync import node_sync
from swarmware.types.tree import TreePlatform
from swarmware.types.tree_exchange import TreeStats


def stats(followed: int, structures: int, subscriptions: int) -> TreeStats:
    return TreeStats(digest=7, followed=followed, structures=structures, subscriptions=subscriptions)


@pytest.mark.parametrize(
    ("counters", "replica", "expected"),
    [
        ((15, 15, 15), TreePlatform("uav1", True, 90, 7), "synced 15/15"),
        ((0, 0, 0), TreePlatform("uav1", True, 90, 7), "synced 0/0"),
        ((15, 14, 15), TreePlatform("uav1", True, 90, 7), "structure 14/15"),
        ((15, 14, 13), TreePlatform("uav1", True, 90, 7), "structure 14/15"),
        ((15, 15, 13), TreePlatform("uav1", True, 90, 7), "values 13/15"),
        ((15, 15, 15), TreePlatform("uav1", True, 90, 6), "behind"),
        ((15, 14, 15), TreePlatform("uav1", True, 0, 0), "behind"),
        ((15, 15, 15), TreePlatform("uav1", True, 0, 0, followed=False), "synced 15/15"),
        ((15, 15, 15), None, "synced 15/15"),
    ],
)
def test_node_is_synchronised_when_digests_agree(
    counters: tuple[int, int, int], replica: TreePlatform | None, expected: str
) -> None:
    assert str(node_sync(stats(*counters), replica)) == expected
