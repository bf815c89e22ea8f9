"""Real brokers over loopback, several nodes in one process, and what tests wait for."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import msgspec
import uvloop
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.broker.config import Config
from swarmd.broker.records.session_store import SessionStore
from swarmd.broker.service import Broker
from swarmware.model.config import load_service
from swarmware.model.frame import Frame
from swarmware.model.names import data_id
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import make_node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.security.root import make_swarm
from swarmware.types.health import CheckReports
from swarmware.types.net import BoardPublication, BoardSubscription, Neighbours, Routes, TreePlan
from swarmware.types.rpc import Empty, Reply
from swarmware.types.scalar import Text
from swarmware.types.traffic import Traffic

T = TypeVar("T", bound=msgspec.Struct)
P = ParamSpec("P")


def on_uvloop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """The test on an event loop of its own, as services have it; it must leave nothing behind."""

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        with no_leaks(), asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(test(*args, **kwargs))

    return run


class Station:
    """One node with its broker, and an application beside it."""

    def __init__(self, config_dir: Path) -> None:
        self.config_dir = config_dir
        self._stack = AsyncExitStack()
        self._broker_stack = AsyncExitStack()
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        self.node = Node.attach(self.config_dir)
        self._stack.callback(self.node.close)
        former = SessionStore(self.node.config.data_path)
        if (
            not former.declared_period_ns
        ):  # it ran at 10 Hz before: a node without data waits longer for routes
            former.next_session(1)
            former.keep(125_000_000)
        self.app = await self._stack.enter_async_context(Module("app", node=self.node))
        self.neighbours: BoardReader[Neighbours] = self.app.reader("net/neighbours", Neighbours)
        self.routes: BoardReader[Routes] = self.app.reader("net/routes", Routes)
        self.counters: BoardReader[Traffic] = self.app.reader("net/traffic", Traffic)
        self.checks: BoardReader[CheckReports] = self.app.reader("health/checks/broker", CheckReports)
        self._plan = self.app.writer("tree/plan", TreePlan)
        await self.start()

    @property
    def platform(self) -> str:
        return self.node.platform

    async def start(self) -> None:
        """Starts the broker."""
        config = load_service(self.config_dir, "broker", Config)
        module = await self._broker_stack.enter_async_context(Module("broker", node=self.node, config=config))
        self._task = asyncio.create_task(Broker(module, config).run(), name=f"broker {self.platform}")

    async def stop(self) -> None:
        """Ends the broker without a leave message.

        Raises: whatever it had failed with.
        """
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
        await self._broker_stack.aclose()
        self._broker_stack = AsyncExitStack()

    async def ended(self) -> None:
        """Raises: whatever the broker failed with."""
        task, self._task = self._task, None
        if task is not None:
            await task

    async def close(self) -> None:
        try:
            await self.stop()
        finally:
            await self._stack.aclose()

    def plan(
        self,
        offers: Iterable[tuple[str, type[msgspec.Struct]]] = (),
        wants: Iterable[tuple[str, str, type[msgspec.Struct]]] = (),
        tree_version: int = 1,
    ) -> None:
        """What the tree would ask of the broker: offers (path, type), wants (platform, path, type)."""
        self._plan.write(
            TreePlan(
                tree_version,
                tuple(
                    BoardPublication(path, data_id(path, cls.__name__), cls.__name__) for path, cls in offers
                ),
                tuple(
                    BoardSubscription(platform, path, cls.__name__, data_id(path, cls.__name__))
                    for platform, path, cls in wants
                ),
            )
        )

    @property
    def group_port(self) -> int:
        return load_service(self.config_dir, "broker", Config).udp_port

    def conditions(self) -> dict[str, str]:
        """What the broker says of its own health."""
        table = self.checks.value
        return {} if table is None else {report.check: report.state for report in table.reports}

    async def traffic(self) -> Traffic:
        return await self.app.request("sys/broker/traffic", Empty(), Traffic, timeout_s=PATIENCE_S)

    def states(self) -> dict[str, str]:
        table = self.neighbours.value
        return {} if table is None else {n.platform: n.state for n in table.neighbours}

    def ways(self) -> dict[str, str]:
        table = self.routes.value
        return {} if table is None else {route.platform: route.via for route in table.routes}

    async def until(self, what: Callable[[], bool], reader: BoardReader[Any]) -> None:
        """Waits until the condition holds for an update of the reader."""
        async with asyncio.timeout(PATIENCE_S):
            while not what():
                await reader.changed()

    async def until_up(self, *platforms: str) -> None:
        await self.until(lambda: all(self.states().get(name) == "up" for name in platforms), self.neighbours)

    async def until_reaches(self, **via: str) -> None:
        await self.until(lambda: all(self.ways().get(k) == v for k, v in via.items()), self.routes)

    async def until_counted(self, what: Callable[[Traffic], bool]) -> Traffic:
        """The counters when they are so."""
        await self.until(lambda: self.counters.value is not None and what(self.counters.value), self.counters)
        return await self.traffic()

    async def until_lost(self, platform: str) -> None:
        await self.until(lambda: platform not in self.ways(), self.routes)


@asynccontextmanager
async def swarm(
    root: Path,
    *names: str,
    hear: Mapping[str, tuple[str, ...]] | None = None,
    keys: bool = True,
    roles: Mapping[str, str] | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    **common: Any,
) -> AsyncIterator[dict[str, Station]]:
    """Nodes with brokers; `hear`: who hears whom; `settings`: of the broker, by platform; `roles`: operator
    where nothing is said."""
    port = free_port()
    if keys:
        given_roles = {name: (roles or {}).get(name, "operator") for name in names}
        await asyncio.to_thread(make_swarm, root / "keys", given_roles)
    async with AsyncExitStack() as stack:
        stations: dict[str, Station] = {}
        for name in names:
            given = {
                "udp_port": port,
                "bind_address": "127.0.0.1",
                "hear_only": (hear or {}).get(name, ()),
                **common,
                **(settings or {}).get(name, {}),
            }
            folder = await asyncio.to_thread(
                make_node,
                root,
                name,
                services={"broker": msgspec.convert(given, Config)},
                keys_dir=str(root / "keys" / name),
            )
            station = stations[name] = Station(folder)
            stack.push_async_callback(station.close)
            await station.open()
        yield stations


class Recorder:
    """A handler that records the address at which it was called."""

    def __init__(self, path: str, called: list[str]) -> None:
        self.path = path
        self.called = called

    def __call__(self, request: Text, _: object) -> Text:
        self.called.append(self.path)
        return request

    def take(self, _: Frame) -> Outcome:
        """In place of an inbox."""
        self.called.append(self.path)
        return Outcome(Status.DELIVERED, self.path)

    def ask(self, _: Frame, __: Callable[[Reply], None]) -> None:
        """In place of a server, before the request is decoded."""
        self.called.append(self.path)


LINE = {"uav1": ("uav2",), "uav2": ("uav1", "uav3"), "uav3": ("uav2",)}
"""uav1 - uav2 - uav3."""
