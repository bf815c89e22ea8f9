"""No node depends on another being there first: any order, any gap between the starts."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from random import Random

import pytest
from tests.integration.swarm.swarm import NAMES, Swarm, swarm, until, until_trees_agree
from tests.patience import PATIENCE_S

from swarmctl.session.labs import LabState
from swarmware.types.health import HealthState
from swarmware.types.system import AppStatus
from swarmware.types.vehicle import Pose

SEED = 7
"""Of the orders of start; printed with each."""
BEATS_LATER = 3
"""A beat comes every second."""


async def converged(made: Swarm) -> float:
    """Seconds until every node knows every tree and has the values that its services read.

    Raises: NoAnswer.
    """
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    async with AsyncExitStack() as stack:
        modules = [await stack.enter_async_context(made.at(platform)) for platform in NAMES]
        await until_trees_agree(*modules)
        for module in modules:
            for platform in {"uav1", "ugv1"} - {module.platform}:
                pose = module.reader(f"/{platform}/nav/pose", Pose)  # carried by the beacon
                for _ in range(2):
                    await pose.changed(PATIENCE_S)
        health = modules[0].readers("/*/health/state", HealthState)  # carried by notifications
        async with asyncio.timeout(PATIENCE_S):
            while {name for name, board in health.items() if board.value is not None} < {"uav1", "ugv1"}:
                await health.changed()
    return loop.time() - began_s


async def beats_passed(made: Swarm, platform: str, count: int) -> None:
    """The long gap: this node has lived alone for so many beats."""
    async with made.at(platform) as module:
        board = module.reader("app/broker/status", AppStatus)
        first = await until(board, lambda now: now.state == "running", "running")
        await until(board, lambda now: now.beat >= first.beat + count, f"{count} beats on")


@pytest.mark.slow
def test_nodes_started_long_apart_find_each_other(
    labs_folder: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    order = ["uav1", "ugv1"]
    Random(SEED).shuffle(order)

    async def run() -> LabState:
        async with swarm("k2order") as made:
            await made.start(order[0])
            await beats_passed(made, order[0], BEATS_LATER)
            await made.start(order[1])
            await beats_passed(made, order[1], 1)
            await made.start("gcs")
            print(
                f"seed {SEED}, {order} and gcs: converged {await converged(made):.2f} s after the last start"
            )
            return made.record

    nothing_remains(asyncio.run(run()))


@pytest.mark.slow
def test_nodes_started_in_any_order_find_each_other(
    labs_folder: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    order = list(NAMES)
    Random(SEED).shuffle(order)

    async def run() -> LabState:
        # a process for each daemon: these too come in whatever order the machine likes
        async with swarm("k2order", per_daemon=order[0]) as made:
            await asyncio.gather(*(made.start(name) for name in order))
            print(f"seed {SEED}, {order}: converged {await converged(made):.2f} s after the last start")
            return made.record

    nothing_remains(asyncio.run(run()))
