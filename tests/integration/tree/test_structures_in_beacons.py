"""Real nodes with keys that join each other: beacons carry the structures of their trees, signed."""

import asyncio
from pathlib import Path

from tests.integration.tree.pair import Platform, on_uvloop, platforms, until
from tests.patience import PATIENCE_S

from swarmware.types.net import StructureBroadcast
from swarmware.types.scalar import Text
from swarmware.types.traffic import Traffic
from swarmware.types.tree_exchange import TreeStats

NAMES = ("uav1", "uav2", "uav3", "uav4")
APART = (("broker",), ("tree",))
TOGETHER = (("broker", "tree"),)
BEACONS_ONLY = {"broadcast_s": 60.0, "keep": []}
"""No subscription, and no request for a structure within the test: whatever arrives came in a beacon."""


async def in_sync(platform: Platform, others: int) -> TreeStats:
    """Waits until it knows the structures that the others have now."""
    stats = platform.probe.reader("tree/stats", TreeStats)
    await stats.changed()  # not what a former start wrote
    return await until(stats, lambda value: value.followed == others == value.structures)


async def until_all_know(nodes: list[Platform], path: str) -> None:
    """Waits until every other node lists a resource of the first one."""
    for node in nodes[1:]:
        await node.until_listed(f"/{nodes[0].name}/{path}", lambda entry: entry is not None)


@on_uvloop
async def test_nodes_join_by_beacons_without_structure_requests(tmp_path: Path) -> None:
    async with platforms(tmp_path, *NAMES, tree=BEACONS_ONLY, services=TOGETHER) as nodes:
        boards = [node.probe.writer(f"plan/step{number}", Text) for number, node in enumerate(nodes)]
        for number, node in enumerate(nodes):
            await until_all_know([node, *(one for one in nodes if one is not node)], f"plan/step{number}")
        for node in nodes:
            await in_sync(node, 3)
            traffic = await until(node.probe.reader("net/traffic", Traffic), lambda _: True)
            assert not traffic.refused.spoofed
        # a change needs no question, either
        nodes[0].probe.close_writer(boards[0])
        nodes[0].probe.writer("plan/other", Text)
        await until_all_know(nodes, "plan/other")
        requests = [(await in_sync(node, 3)).requests_sent for node in nodes]
        # a large structure is requested, and so is one before multicast is known to reach its node
        assert sum(requests) <= 4, f"{requests}: by requests alone it were one for each of the others, 12"


@on_uvloop
async def test_restarted_tree_gets_all_structures_from_beacons(tmp_path: Path) -> None:
    async with platforms(tmp_path, *NAMES[:3], tree=BEACONS_ONLY, services=APART) as nodes:
        for node in nodes:
            await in_sync(node, 2)
        asked = (await in_sync(nodes[1], 2)).requests_sent  # before multicast was known to reach a node
        received = nodes[1].probe.stream_reader("net/structures", StructureBroadcast)
        await nodes[0].end("tree")
        await nodes[0].start("tree")
        async with asyncio.timeout(PATIENCE_S):
            async for structure in received:
                if structure.node == "uav1":
                    break
        assert (await in_sync(nodes[0], 2)).requests_sent == 0
        assert (await in_sync(nodes[1], 2)).requests_sent == asked


@on_uvloop
async def test_tree_without_structures_in_beacons_requests_them(tmp_path: Path) -> None:
    tree = {"broadcast_s": 0.0, "keep": []}
    async with platforms(tmp_path, *NAMES[:3], tree=tree, services=APART) as nodes:
        for node in nodes:
            await in_sync(node, 2)
        await nodes[0].end("tree")
        await nodes[0].start("tree")
        assert (await in_sync(nodes[0], 2)).requests_sent >= 2
