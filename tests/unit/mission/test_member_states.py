"""States of other platforms: at once in a mission; without one together, and before a decision by them."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from swarmd.mission import member_states
from swarmd.mission.member_states import MemberStates
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id
from swarmware.module.module import Module
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.mission import NOT_STARTED, MissionState

PATH = "mission/state"


class Rig:
    """Two other platforms, and the states that were passed on."""

    def __init__(self, mirrors: dict[str, Publication]) -> None:
        self.mirrors = mirrors
        self.taken: list[str] = []
        self.idle = True
        self.took = asyncio.Event()
        self.states: MemberStates

    def take(self, platforms: tuple[str, ...]) -> None:
        self.taken += sorted(platforms)
        self.took.set()

    def publish(self, platform: str) -> None:
        frame = Frame(
            FrameKind.BOARD,
            data_id(PATH, "MissionState"),
            payload=registry.encode(MissionState(0, "", NOT_STARTED)),
        )
        self.mirrors[platform].publish(encode(frame))

    async def next(self) -> list[str]:
        """What is passed on next."""
        async with asyncio.timeout(20):
            await self.took.wait()
        self.took.clear()
        taken, self.taken = self.taken, []
        return taken


@asynccontextmanager
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    async with tmp_node(tmp_path) as node, Module("mission", node=node) as m:
        made = Rig({name: node.mirror_writer(name, PATH) for name in ("uav7", "uav8")})
        boards = m.readers(f"/*/{PATH}", MissionState)
        made.states = MemberStates(boards, node.clock, lambda: made.idle, made.take)
        running = asyncio.create_task(made.states.run())
        try:
            yield made
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            for mirror in made.mirrors.values():
                mirror.close()


async def bells() -> None:
    """Run the tasks that were woken by what was written."""
    for _ in range(10):
        await asyncio.sleep(0.001)


async def test_changes_without_mission_wait_for_decision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(member_states, "IDLE_NS", 3600 * 1_000_000_000)
    async with rig(tmp_path) as swarm:
        swarm.publish("uav7")
        assert await swarm.next() == ["uav7"]
        swarm.publish("uav7")
        swarm.publish("uav8")
        await bells()
        assert swarm.taken == []
        swarm.states.take_news()
        assert await swarm.next() == ["uav7", "uav8"]
        swarm.states.take_news()
        assert swarm.taken == [], "each change is passed on once"


async def test_mission_start_releases_waiting_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(member_states, "IDLE_NS", 3600 * 1_000_000_000)
    async with rig(tmp_path) as swarm:
        swarm.publish("uav7")
        assert await swarm.next() == ["uav7"]
        swarm.publish("uav8")
        await bells()
        assert swarm.taken == []
        swarm.idle = False
        swarm.states.on_mission()
        assert await swarm.next() == ["uav8"]
        for name in ("uav7", "uav8", "uav7"):
            swarm.publish(name)
            assert await swarm.next() == [name]


async def test_changes_without_mission_pass_at_next_instant(tmp_path: Path) -> None:
    async with rig(tmp_path) as swarm:
        swarm.publish("uav7")
        assert await swarm.next() == ["uav7"]
        swarm.publish("uav8")
        assert await swarm.next() == ["uav8"], "without any other event"
