"""Real nodes over loopback, a process each, and what tests wait for."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import msgspec
import uvloop
from tests.patience import PATIENCE_S, until_answer
from tests.ports import free_port

from swarmware.errors import NotFound
from swarmware.model import names
from swarmware.model.names import platform_of
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import Process, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.root import make_swarm
from swarmware.types.tree import TreeEntry, TreeGet, TreeList, TreeListing, TreeSet, TreeSetDone, TreeValue

T = TypeVar("T", bound=msgspec.Struct)
P = ParamSpec("P")

SERVICES = ("broker", "tree", "register")


def on_uvloop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """The test on an event loop of its own, as services have it; it must leave nothing behind."""

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        with no_leaks(), asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(test(*args, **kwargs))

    return run


class Platform:
    """One node: its processes, and an application of the test on it."""

    def __init__(self, name: str, config_dir: Path) -> None:
        self.name = name
        self.config_dir = config_dir
        self.probe = Module("probe", config_dir=config_dir)
        self._stack = AsyncExitStack()
        self._started: dict[tuple[str, ...], Process] = {}

    async def start(self, *services: str) -> Process:
        """A process with these services, ready."""
        process = await self._stack.enter_async_context(spawn(self.config_dir, *services))
        self._started[services] = process
        return process

    async def end(self, *services: str) -> None:
        """Ends the process of these services in good order."""
        assert await self._started.pop(services).terminate() == 0

    async def open(self) -> None:
        await self._stack.enter_async_context(self.probe)

    async def close(self) -> None:
        for services, process in list(self._started.items()):
            if process.returncode is None:
                await self.end(*services)
        await self._stack.aclose()

    # -- what operators do

    async def get(self, path: str, *, fresh: bool = False) -> TreeValue:
        """Of the copy at this node, else of the owner."""
        if not fresh:
            try:
                return await self.probe.request(
                    "sys/tree/get", TreeGet(path), TreeValue, timeout_s=PATIENCE_S
                )
            except NotFound:
                pass
        return await self.probe.request(_owner(path, "get"), TreeGet(path), TreeValue, timeout_s=PATIENCE_S)

    async def set(self, path: str, value: object, version: int | None = None) -> TreeSetDone:
        wish = TreeSet(path, msgspec.msgpack.encode(value), version)
        return await self.probe.request(_owner(path, "set"), wish, TreeSetDone, timeout_s=PATIENCE_S)

    async def list(self, pattern: str) -> dict[str, TreeEntry]:
        found = await self.probe.request(
            "sys/tree/list", TreeList(pattern), TreeListing, timeout_s=PATIENCE_S
        )
        return {entry.path: entry for entry in found.entries}

    async def until_listed(self, path: str, what: Callable[[TreeEntry | None], bool]) -> None:
        """Waits until the tree of this node says so of a resource: asks at each of its beats."""
        await until_answer(lambda: self.list(path), lambda found: what(found.get(path)))


def _owner(path: str, verb: str) -> str:
    """The request at the platform of a resource."""
    platform = names.split(path)[0]
    return names.join(platform, f"sys/tree/{verb}") if platform else f"sys/tree/{verb}"


async def until(reader: BoardReader[T], what: Callable[[T], bool]) -> T:
    """The first value that is so."""
    async with asyncio.timeout(PATIENCE_S):
        value = reader.value
        while value is None or not what(value):
            value = await reader.changed()
        return value


@asynccontextmanager
async def platforms(
    root: Path,
    *names: str,
    hear: Mapping[str, tuple[str, ...]] | None = None,
    tree: Mapping[str, Any] | None = None,
    templates: Mapping[str, str] | None = None,
    services: tuple[tuple[str, ...], ...] = (SERVICES,),
    start: bool = True,
) -> AsyncIterator[list[Platform]]:
    """Nodes that run; `uav1.fc` is a unit of uav1.

    `hear`: who hears whom, `tree`: settings of the tree, `services`: of each process.
    """
    port = free_port()
    roles = {platform_of(name): "maintainer" if name == "gcs" else "node" for name in names}
    await asyncio.to_thread(make_swarm, root / "keys", roles)
    async with AsyncExitStack() as stack:
        found = []
        for name in names:
            given: dict[str, Any] = {
                "broker": {
                    "udp_port": port,
                    "bind_address": "127.0.0.1",
                    "hear_only": list((hear or {}).get(name, ())),
                },
                "tree": dict(tree or {}),
            }
            folder = await asyncio.to_thread(
                make_node,
                root,
                name,
                services=given,
                keys_dir=str(root / "keys" / platform_of(name)),
                template=(templates or {}).get(name, "gcs"),
            )
            platform = Platform(name, folder)
            stack.push_async_callback(platform.close)
            await platform.open()
            found.append(platform)
        if start:
            jobs = [platform.start(*group) for platform in found for group in services]
            await asyncio.gather(*jobs)
        yield found
