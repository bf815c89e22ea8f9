"""A whole node is killed and started again: the others notice, and everything between them heals."""

import asyncio
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import msgspec
import pytest
from tests.integration.swarm.swarm import Swarm, swarm, until, until_link, until_trees_agree
from tests.patience import PATIENCE_S

from swarmctl.session.labs import LabState
from swarmware.module.module import Module
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import FolderSource, Query, stats
from swarmware.types.health import HealthState
from swarmware.types.log import LogStats
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo
from swarmware.types.vehicle import Pose

BATCH_S = 0.6
"""What the logger has not yet written: its flush_s and a period_s."""


class Life(msgspec.Struct):
    """A kill and what came after it."""

    killed_utc_ns: int
    started_utc_ns: int


async def fresh_pose(module: Module, platform: str) -> float:
    """Seconds until poses of the platform flow to this node (again)."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    pose = module.reader(f"/{platform}/nav/pose", Pose)
    for _ in range(3):  # one may have been on its way when its sender died
        await pose.changed(PATIENCE_S)
    pose.close()
    return loop.time() - began_s


async def kill_and_start(made: Swarm, victim: str, others: list[Module]) -> Life:
    async with made.at(victim) as module:  # the log has begun, and is in the middle of a batch
        log = module.reader("log/stats", LogStats)
        begun = await until(log, lambda now: now.frames > 0, "begun")
        await until(log, lambda now: now.frames > begun.frames, "going on")
        pose = module.reader("nav/pose", Pose)
        for _ in range(5):
            await pose.changed(PATIENCE_S)
    took: dict[str, float] = {}
    loop = asyncio.get_running_loop()
    ground = others[0]
    before = await ground.request(f"/{victim}/sys/node/info", Empty(), NodeInfo)
    health = ground.reader(f"/{victim}/health/state", HealthState)
    killed_utc_ns, killed_s = time.time_ns(), loop.time()
    await made.kill(victim)
    for module in others:
        await until_link(module, victim, is_up=False)
        took[f"{module.platform}: down"] = loop.time() - killed_s
    started_utc_ns = time.time_ns()
    await made.start(victim)
    ready_s = loop.time()
    for module in others:
        await until_link(module, victim, is_up=True)
        took[f"{module.platform}: up"] = loop.time() - ready_s
        await fresh_pose(module, victim)
        took[f"{module.platform}: poses"] = loop.time() - ready_s
    await health.changed(PATIENCE_S)  # a notification: the subscription is held by the new process
    took["notified"] = loop.time() - ready_s
    async with made.at(victim) as module:
        await until_trees_agree(module, *others)
        took["trees"] = loop.time() - ready_s
        for other in {"uav1", "ugv1"} - {victim}:
            await fresh_pose(module, other)
        took["its mirrors"] = loop.time() - ready_s
    after = await ground.request(f"/{victim}/sys/node/info", Empty(), NodeInfo)
    assert after.boot_id != before.boot_id
    print(victim, {what: round(seconds, 2) for what, seconds in took.items()})
    return Life(killed_utc_ns, started_utc_ns)


def check_log(entries: list[LogEntry], life: Life) -> None:
    """Nothing is missing but what was not yet written at the kill, and nothing is there twice."""
    assert all(queue.missing == 0 for queue in stats(entries)), stats(entries)
    assert len({(entry.queue, entry.sequence) for entry in entries}) == len(entries)
    assert not [entry.plain() for entry in entries if entry.path == "log/gaps"]
    poses = [entry.utc_ns for entry in entries if entry.path == "nav/pose"]
    last_ns = max(utc_ns for utc_ns in poses if utc_ns < life.killed_utc_ns)
    first_ns = min(utc_ns for utc_ns in poses if utc_ns > life.started_utc_ns)
    before_s, after_s = (life.killed_utc_ns - last_ns) / 1e9, (first_ns - life.started_utc_ns) / 1e9
    print(
        f"logged: {before_s:.2f} s before the kill, {after_s:.2f} s after the start, {len(entries)} entries"
    )
    assert before_s < 2 * BATCH_S


@pytest.mark.slow
def test_killed_node_is_missed_and_heals_at_return(
    labs_folder: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    async def run() -> LabState:
        async with swarm("k2node", per_daemon="ugv1") as made:
            await made.start("gcs", "uav1", "ugv1")
            async with AsyncExitStack() as stack:
                ground = await stack.enter_async_context(made.at("gcs"))
                for victim, other in (("uav1", "ugv1"), ("ugv1", "uav1")):
                    async with made.at(other) as neighbour:
                        await until_trees_agree(ground, neighbour)
                        life = await kill_and_start(made, victim, [ground, neighbour])
                    assert (await made.terminate(victim))[0] == 0
                    folder = made.record.node(victim).data_dir / "log"
                    check_log(list(FolderSource([folder]).entries(Query())), life)
                    if victim == "uav1":  # the other one is killed beside it
                        await made.start(victim)
            return made.record

    nothing_remains(asyncio.run(run()))
