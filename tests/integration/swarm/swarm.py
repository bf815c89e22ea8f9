"""A lab in the hands of a test: its nodes are started, killed, ended and started again one by one."""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TypeVar

import msgspec
from tests.patience import PATIENCE_S

from swarmctl.session import processes
from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK
from swarmlab.provision import provisioning
from swarmlab.provision.provisioning import LabSpec
from swarmlab.run.running import RunningLab
from swarmware.errors import NoAnswer, SwarmError
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.net import Neighbours
from swarmware.types.tree import TreeList, TreeListing
from swarmware.types.tree_exchange import TreeStats

T = TypeVar("T", bound=msgspec.Struct)

NAMES = ("gcs", "ugv1", "uav1")


class Swarm:
    """The nodes of one lab, children of this process."""

    def __init__(self, lab: LabState) -> None:
        self.record = lab
        self._starts: dict[str, RunningLab] = {}

    async def start(self, *platforms: str) -> None:
        """Starts these nodes and returns when each has said that it is ready."""
        started = RunningLab(self.record, heals=False)  # whoever kills a node here also starts it again
        for platform in platforms:
            if (
                before := self._starts.pop(platform, None)
            ) is not None and before not in self._starts.values():
                before.stop_watching()
            self._starts[platform] = started
        try:
            await started.start(list(platforms), PATIENCE_S)
        finally:
            self.record = started.state

    async def kill(self, platform: str) -> None:
        """All processes of the node at once, and no code of theirs runs any more."""
        folder = self.record.node(platform).folder
        # again: between the first and the last of them one may still have started another
        while gone := processes.marked(folder, NODE_MARK):
            for process in gone:
                process.send(signal.SIGKILL)
            assert await asyncio.to_thread(processes.wait_gone, gone, PATIENCE_S) == []

    async def terminate(self, platform: str) -> tuple[int, float]:
        """SIGTERM to the node's main process; its exit code, and the seconds until all of the node ended."""
        node, started = self.record.node(platform), self._starts[platform]
        all_of_it = processes.marked(node.folder, NODE_MARK)
        began_s = asyncio.get_running_loop().time()
        node.identity.send(signal.SIGTERM)
        async with asyncio.timeout(PATIENCE_S):
            while platform not in started.fallen:
                await started.until_fallen(tuple(started.fallen))
        assert await asyncio.to_thread(processes.wait_gone, all_of_it, PATIENCE_S) == []
        return started.fallen[platform], asyncio.get_running_loop().time() - began_s

    @asynccontextmanager
    async def at(self, platform: str) -> AsyncIterator[Module]:
        """Joins a node with this process, as one of its applications, for a short time."""
        async with Module("probe", config_dir=self.record.node(platform).config_dir) as module:
            yield module

    async def down(self) -> None:
        """As `swarmctl lab down`."""
        await asyncio.to_thread(provisioning.down, self.record)

    def collect(self) -> None:
        """The children's exit codes, so that none is left as a zombie."""
        for started in set(self._starts.values()):
            started.stop_watching()
            started.wait_children()


@asynccontextmanager
async def swarm(name: str, *, per_daemon: str | None = None, seed: int = 1) -> AsyncIterator[Swarm]:
    """A lab of three nodes of which none is started yet; what of it runs at the end is ended."""
    wish = LabSpec(experiment="formation", nodes=3, seed=seed, name=name, per_daemon=per_daemon)
    made = Swarm(await asyncio.to_thread(provisioning.make, wish))
    try:
        yield made
    finally:
        await made.down()
        made.collect()


async def until(board: BoardReader[T], wanted: Callable[[T], bool], what: str) -> T:
    """The board's value as soon as it is as wanted; looked at again whenever it is written.

    Raises: NoAnswer with the last value.
    """
    try:
        async with asyncio.timeout(PATIENCE_S):
            while (value := board.value) is None or not wanted(value):
                await board.changed()
            return value
    except TimeoutError:
        raise NoAnswer(f"{board.path}: not {what} within {PATIENCE_S} s: {board.value}") from None


def up(neighbours: Neighbours) -> set[str]:
    """Platforms to which there is a link in both directions."""
    return {one.platform for one in neighbours.neighbours if one.state == "up"}


async def until_link(module: Module, platform: str, *, is_up: bool) -> float:
    """Seconds until the neighbour is up, or is not."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    board = module.reader("net/neighbours", Neighbours)
    try:
        word = f"{'with' if is_up else 'without'} {platform}"
        await until(board, lambda now: (platform in up(now)) is is_up, word)
    finally:
        board.close()
    return loop.time() - began_s


async def digests(module: Module) -> dict[str, tuple[int, bool]]:
    """Digest of each tree that the node knows, its own among them, and whether that platform is reached."""
    listing = await module.request("sys/tree/list", TreeList(limit=1), TreeListing)
    return {one.platform: (one.digest, one.reachable) for one in listing.platforms}


async def until_trees_agree(*modules: Module) -> float:
    """Seconds until every node has the tree of every node as that one has it itself."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    stats = modules[0].reader("tree/stats", TreeStats)
    found: dict[str, dict[str, tuple[int, bool]]] = {}
    try:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                with suppress(SwarmError):  # a tree service that has just been started does not answer yet
                    found = {module.platform: await digests(module) for module in modules}
                if _agree(found):
                    return loop.time() - began_s
                await stats.changed()
    except TimeoutError:
        raise NoAnswer(f"the trees differ after {PATIENCE_S} s: {found}") from None
    finally:
        stats.close()


def _agree(found: dict[str, dict[str, tuple[int, bool]]]) -> bool:
    views = list(found.values())
    return all(
        view == views[0]
        and view.keys() == set(NAMES)
        and all(digest and near for digest, near in view.values())
        for view in views
    ) and bool(views)


def remains_of_node(lab: LabState, platform: str) -> list[str]:
    """What a node that ended in peace left: only two lock files of its last start may stay."""
    node = lab.node(platform)
    places = (node.run_dir, Path(node.shm_dir))
    found = [path for place in places for path in place.rglob("*") if not path.is_dir()]
    return [str(path) for path in found if path.name not in {"boot", "master.lock"}]
