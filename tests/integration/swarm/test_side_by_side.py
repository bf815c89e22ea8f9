"""Two swarms on the same multicast group and port: each receives only its own nodes."""

import asyncio
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.integration.swarm.swarm import NAMES, Swarm, swarm, until, until_trees_agree, up
from tests.patience import PATIENCE_S

from swarmctl.session import labs
from swarmctl.session.labs import LabState
from swarmware.module.module import Module
from swarmware.types.net import Neighbours
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo
from swarmware.types.traffic import Traffic


async def boots(made: Swarm) -> set[int]:
    """Boot numbers of the nodes of a swarm, which distinguish two swarms with the same names."""
    found = set()
    for platform in NAMES:
        async with made.at(platform) as module:
            found.add(
                (await module.request("sys/node/info", Empty(), NodeInfo, timeout_s=PATIENCE_S)).boot_id
            )
    return found


async def heard(module: Module) -> set[int]:
    """Boots of the nodes to which there is a link."""
    board = module.reader("net/neighbours", Neighbours)
    now = await until(board, lambda now: up(now) == set(NAMES) - {module.platform}, "with all of its own")
    return {one.boot_id for one in now.neighbours}


async def check(made: Swarm, own: set[int]) -> None:
    async with made.at("gcs") as ground, made.at("uav1") as vehicle:
        await until_trees_agree(ground, vehicle)
        for module in (ground, vehicle):
            assert await heard(module) < own
            traffic = module.reader("net/traffic", Traffic)
            now = await until(
                traffic, lambda now: now.refused.other_swarm > 0, "without the other swarm's datagrams"
            )
            print(f"{made.record.folder} {module.platform}: {now.refused.other_swarm} datagrams of strangers")


@pytest.mark.slow
def test_two_equally_named_swarms_stay_apart(
    labs_folder: Path, monkeypatch: pytest.MonkeyPatch, nothing_remains: Callable[[LabState], None]
) -> None:
    async def run() -> None:
        async with swarm("k2twin") as left:
            monkeypatch.setenv("SWARMCTL_LABS", str(labs_folder / "other"))
            async with swarm("k2twin", seed=2) as right:
                for platform in NAMES:  # as if two operators had chosen the same numbers
                    ours, theirs = (made.record.node(platform).config_dir for made in (left, right))
                    shutil.copy(ours / "services/broker.toml", theirs / "services/broker.toml")
                await asyncio.gather(left.start(*NAMES), right.start(*NAMES))
                own = await boots(left), await boots(right)
                assert len(own[0] | own[1]) == 2 * len(NAMES)
                await check(left, own[0])
                await check(right, own[1])
                # what the doctor takes for leftovers is what belongs to none of these
                assert {made.record.folder for made in (left, right)} <= {
                    lab.folder for lab in labs.running_labs()
                }
                await right.down()
            nothing_remains(right.record)
            async with left.at("gcs") as ground, left.at("uav1") as vehicle:
                await until_trees_agree(ground, vehicle)
                assert await heard(ground) < own[0]
        nothing_remains(left.record)

    asyncio.run(run())
