"""The tree's shell: tells the core what happens, carries out what comes back."""

import asyncio
import logging
from collections.abc import Callable

from swarmd.tree import config as own
from swarmd.tree.answers import Answers
from swarmd.tree.core.action import Action, AskStructure, AskSubscription, Forget, SendNotify, Unwatch, Watch
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.settings import Settings
from swarmd.tree.store import Store
from swarmd.tree.taps import Mirrors, Peek, Tap
from swarmware import template
from swarmware.appfile import AppTable
from swarmware.errors import SwarmError
from swarmware.module import BoardReader, BoardWriter, Inbox, Meta, Module
from swarmware.node import Node
from swarmware.node.node import APPS_TABLE
from swarmware.resource import Resource
from swarmware.service import Service
from swarmware.types.net import Neighbours, Routes, TreePlan
from swarmware.types.tree import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeChange,
    TreeItem,
    TreeNotify,
    TreeStats,
)

PROBE_S = 1.0
"""How often applications that died without a word are looked for."""

log = logging.getLogger("swarm.tree")


class Applications:
    """Tells when the application files of this node have changed."""

    def __init__(self, node: Node, tell: Callable[[], None]) -> None:
        self._node = node
        self._tell = tell
        self._bells = node.shm_dir / APPS_TABLE
        self.table = AppTable(node.run_dir)
        node.listen(self._bells)
        node.watch(self)

    def poll(self, *, probe: bool = False) -> None:
        """The doorbell has rung, perhaps for us."""
        if self.table.refresh(probe=probe):
            self._tell()

    def close(self) -> None:
        """Looks no more."""
        self._node.unwatch(self)
        self._node.unlisten(self._bells)


class Tree(Service):
    """The resource tree of this platform, and what is known of the others'."""

    name = "tree"
    Config = own.Config
    config: own.Config

    def __init__(self, module: Module, config: own.Config) -> None:
        super().__init__(module, config)
        node = module.node
        folder = node.config.share_path / "templates"
        self._tree = SwarmTree(
            module.platform,
            template.load(node.config.template, folder).resources,
            # the low bits of the clock at the start: another number each time
            epoch=module.now_ns() // 1000 & 0x7FFF_FFFF,
            limits=config.limits(),
            templates=[found.resources for found in template.load_all(folder)],
            rules=config.rules,
        )
        self._peek = Peek(node)
        self._mirrors = Mirrors(node)
        self._taps: dict[str, Tap] = {}
        self._reached: dict[str, tuple[int | None, bool]] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._stats = _Counts()
        self._settings = Settings(module, Store(node.config.data_path / "settings.toml"))

    async def run(self) -> None:
        """Serves, follows and mirrors until cancelled."""
        module = self.module
        self._plan: BoardWriter[TreePlan] = await module.writer("tree/plan", TreePlan, link="request")
        stats = await module.writer("tree/stats", TreeStats, rate_hz=1.0, link="request")
        changes = await module.writer("tree/changes", TreeChange, kind="event", link="request", log="all")
        notes = await module.inbox("sys/tree/notify", TreeNotify, description="Values of another platform")
        await module.serve("sys/tree/structure", StructureRequest, self._on_structure, reply=StructureReply)
        await module.serve("sys/tree/subscribe", SubscribeRequest, self._on_subscribe, reply=SubscribeReply)
        answers = Answers(module, self._tree, self._settings, self._peek, changes, self.config.answer_s)
        await answers.serve()
        neighbours = await module.reader("net/neighbours", Neighbours)
        routes = await module.reader("net/routes", Routes)
        news = asyncio.Event()
        applications = Applications(module.node, news.set)
        try:
            applications.table.refresh(probe=True)
            await self._take_applications(applications.table)
            async with asyncio.TaskGroup() as group:
                group.create_task(self._follow_applications(applications, news), name="tree:apps")
                group.create_task(self._follow_notes(notes), name="tree:notes")
                for board in (neighbours, routes):
                    group.create_task(
                        self._follow_reach(board, neighbours, routes), name=f"tree:{board.path}"
                    )
                group.create_task(self._report(stats, applications), name="tree:stats")
        finally:
            applications.close()
            for tap in self._taps.values():
                tap.close()
            if self._timer is not None:
                self._timer.cancel()
            self._mirrors.close()
            self._peek.close()

    # -- what happens here

    async def _follow_applications(self, applications: Applications, news: asyncio.Event) -> None:
        while True:
            await news.wait()
            news.clear()
            await self._take_applications(applications.table)

    async def _take_applications(self, table: AppTable) -> None:
        provided = [resource for entry in table for resource in entry.provides]
        reads = {pattern for entry in table for pattern in entry.reads}
        self._tree.set_applications(provided, reads, self.module.now_ns())
        await self._settings.publish(leaf.resource for leaf in self._tree.local.index)
        self._act()

    async def _report(self, stats: BoardWriter[TreeStats], applications: Applications) -> None:
        async for _ in self.module.every(PROBE_S):
            applications.poll(probe=True)
            stats.write(self._stats.report(self._tree))

    # -- what others do

    async def _follow_reach(
        self,
        board: BoardReader[Neighbours] | BoardReader[Routes],
        neighbours: BoardReader[Neighbours],
        routes: BoardReader[Routes],
    ) -> None:
        while True:
            await board.changed()
            self._on_reach(neighbours.value, routes.value)

    def _on_reach(self, neighbours: Neighbours | None, routes: Routes | None) -> None:
        now_ns = self.module.now_ns()
        found: dict[str, tuple[int | None, bool]] = {}
        for route in routes.routes if routes is not None else ():
            found[route.platform] = (route.tree_version or None, False)
        for one in neighbours.neighbours if neighbours is not None else ():
            if one.platform and one.state == "up":
                found[one.platform] = (one.tree_version or None, True)
        found.pop(self.module.platform, None)
        for platform in self._reached.keys() - found.keys():
            self._tree.on_gone(platform, now_ns)
        for platform, (version, near) in found.items():
            if self._reached.get(platform) != (version, near):
                self._tree.on_up(platform, version, near, now_ns)
        self._reached = found
        self._act()

    async def _follow_notes(self, notes: Inbox[TreeNotify]) -> None:
        async for note in notes:
            items = self._tree.on_notify(note, self.module.now_ns())
            self._stats.notes += 1
            for item in items:
                self._stats.values_in += 1
                try:
                    self._mirrors.write(note.platform, item)
                except SwarmError as error:
                    log.warning("mirror of /%s/%s: %s", note.platform, item.path, error)
            self._act()

    def _on_structure(self, request: StructureRequest, _: Meta) -> StructureReply:
        self._stats.answered += 1
        reply = self._tree.on_structure_asked(request)
        self._later()
        return reply

    def _on_subscribe(self, request: SubscribeRequest, _: Meta) -> SubscribeReply:
        self._stats.answered += 1
        reply = self._tree.on_subscribe_asked(request, self.module.now_ns())
        self._later()
        return reply

    def _later(self) -> None:
        """The answer goes out first, then what follows from it."""
        asyncio.get_running_loop().call_soon(self._act)

    # -- what the core wants

    def _act(self) -> None:
        while actions := self._tree.drain():
            for action in actions:
                self._do(action)
        if (plan := self._tree.plan()) is not None:
            offers, wants, version = plan
            self._plan.write(TreePlan(version, tuple(offers), tuple(wants)))
        self._arm()

    def _do(self, action: Action) -> None:
        match action:
            case AskStructure():
                self.module.start(self._ask_structure(action), f"structure of {action.platform}")
            case AskSubscription():
                self.module.start(self._ask_subscription(action), f"subscription at {action.platform}")
            case SendNotify():
                self.module.start(self._send(action), f"notify {action.platform}")
            case Watch():
                self._watch(action.resource)
            case Unwatch():
                if tap := self._taps.pop(action.path, None):
                    tap.close()
            case Forget():
                self._mirrors.forget(action.platform)

    def _watch(self, resource: Resource) -> None:
        if old := self._taps.pop(resource.path, None):
            old.close()
        self._taps[resource.path] = Tap(self.module.node, resource, self._on_value)

    def _on_value(self, item: TreeItem) -> None:
        self._tree.on_value(item, self.module.now_ns())
        self._later()

    async def _ask_structure(self, action: AskStructure) -> None:
        self._stats.asked += 1
        reply: StructureReply | None = None
        try:
            reply = await self.module.request(
                f"/{action.platform}/sys/tree/structure",
                action.request,
                StructureReply,
                timeout_s=self.config.answer_s,
            )
        except SwarmError as error:
            log.debug("structure of %s: %s", action.platform, error)
        self._tree.on_structure(action.platform, reply, self.module.now_ns())
        self._act()

    async def _ask_subscription(self, action: AskSubscription) -> None:
        self._stats.asked += 1
        reply: SubscribeReply | None = None
        try:
            reply = await self.module.request(
                f"/{action.platform}/sys/tree/subscribe",
                action.request,
                SubscribeReply,
                timeout_s=self.config.answer_s,
            )
        except SwarmError as error:
            log.debug("subscription at %s: %s", action.platform, error)
        self._tree.on_subscribed(action.platform, reply, action.request.set_digest, self.module.now_ns())
        self._act()

    async def _send(self, action: SendNotify) -> None:
        outcome = await self.module.send(
            f"/{action.platform}/sys/tree/notify", action.notify, timeout_s=self.config.answer_s
        )
        if outcome:
            self._stats.sent += 1
            self._stats.values_out += len(action.notify.items)
        else:
            self._stats.failed += 1
        self._tree.on_notified(action.platform, bool(outcome), self.module.now_ns())
        self._act()

    # -- time

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        deadline_ns = self._tree.deadline_ns()
        if deadline_ns is not None:
            wait_s = max(0.0, (deadline_ns - self.module.now_ns()) / 1e9)
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        self._tree.on_timer(self.module.now_ns())
        self._act()


class _Counts:
    """What the service did."""

    def __init__(self) -> None:
        self.asked = self.answered = self.sent = self.values_out = self.notes = self.values_in = 0
        self.failed = 0

    def report(self, tree: SwarmTree) -> TreeStats:
        """The board."""
        return TreeStats(
            len(tree.local.index),
            sum(1 for name in tree.remotes.platforms() if _known(tree, name)),
            self.asked,
            self.answered,
            len(tree.held.subscribers()),
            tree.held.feeds,
            self.sent,
            self.values_out,
            self.notes,
            self.values_in,
            self.failed,
            tree.held.dropped,
        )


def _known(tree: SwarmTree, platform: str) -> bool:
    remote = tree.remotes.get(platform)
    return remote is not None and remote.index is not None
