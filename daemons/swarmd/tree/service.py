"""The tree's shell: feeds the core with events, and executes its actions."""

import asyncio
import contextlib
import logging
import secrets
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

from swarmd.tree import config as own
from swarmd.tree.boundary import Boundary
from swarmd.tree.core.action import (
    Action,
    PruneMirrors,
    RemoveMirrors,
    RequestStructure,
    RequestSubscription,
    SendNotify,
    Unwatch,
    Watch,
    WriteMirror,
)
from swarmd.tree.core.lane import WINDOW
from swarmd.tree.core.reach import Reachability, reachable
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.operator_api import OperatorApi
from swarmd.tree.settings import Settings
from swarmd.tree.store import SettingsStore
from swarmd.tree.taps import Peek, Tap
from swarmware.errors import ConfigError, Denied, SwarmError
from swarmware.model import names, template
from swarmware.model.resource import Resource
from swarmware.module.board import BoardReader
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.node.applications import Applications
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.service.service import Service
from swarmware.types.mission import MissionState
from swarmware.types.net import ChannelLimits, Neighbours, Routes, TreePlan
from swarmware.types.tree import (
    StreamLoss,
    StreamLosses,
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeChange,
    TreeItem,
    TreeNotify,
    TreeStats,
)

PROBE_S: Final = 1.0
"""Period of looking for applications that died without leaving."""
AT_ONCE: Final = 32
"""Maximum number of concurrent requests to other trees, in a large swarm."""

log = logging.getLogger("swarm.tree")


class Tree(Service):
    """The resource tree of this platform, and replicas of others."""

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
            config,
            epoch=secrets.randbits(31) + 1,
            templates=_templates(folder),
            keep=config.kept(node.config.kind),
        )
        self._peek = Peek(node.shm_dir)
        self._mirrors = MirrorWriter(node)
        self._settings = Settings(module, SettingsStore(node.config.data_path / "settings.toml"))
        self._taps: dict[str, Tap] = {}
        self._reached: dict[str, Reachability] = {}
        self._boundary = Boundary()
        self._driver = self.drive(self._tree, self._perform, settled=self._settled, boundary=self._of_action)
        self._structure = 0
        """Digest of the structure whose settings are published."""
        self._losses = StreamLosses()
        self._at_once = asyncio.Semaphore(AT_ONCE)
        self._mission = 0
        self._asked = self._answered = self._notes = self._values_in = 0

    async def run(self) -> None:
        """Serve requests, replicate and mirror until cancelled."""
        module = self.module
        with contextlib.ExitStack() as stack:
            stack.callback(self._close)
            self._plan: BoardWriter[TreePlan] = module.writer("tree/plan", TreePlan, link="request")
            stats = module.writer("tree/stats", TreeStats, rate_hz=1.0, link="request")
            losses = module.writer("tree/losses", StreamLosses, link="request")
            losses.write(self._losses)
            changes = module.stream_writer(
                "tree/changes", TreeChange, kind="event", link="request", log="all"
            )
            notes = module.inbox("sys/tree/notify", TreeNotify, limit=4 * WINDOW)
            neighbours = module.reader("net/neighbours", Neighbours)
            routes = module.reader("net/routes", Routes)
            mission = module.reader("mission/state", MissionState)
            limits = module.reader("net/limits", ChannelLimits)
            news = asyncio.Event()
            applications = module.node.applications
            stack.callback(applications.subscribe(lambda _: news.set()).close)
            self._operator_api = OperatorApi(
                module,
                self._tree,
                self._settings,
                self._peek,
                applications,
                changes,
                self.config.answer_s,
                self._driver.feed,
            )
            for platform in self._mirrors.platforms():
                self._driver.feed(self._tree.on_former_mirrors(platform, module.now_ns()))
            # before the first reply: others must not receive a tree without its applications
            self._take_applications(applications)
            module.serve("sys/tree/structure", StructureRequest, self._on_structure, reply=StructureReply)
            module.serve("sys/tree/subscribe", SubscribeRequest, self._on_subscribe, reply=SubscribeReply)
            self._operator_api.serve()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._driver.run(), name="tree:driver")
                group.create_task(self._follow_applications(applications, news), name="tree:apps")
                group.create_task(self._follow_notes(notes), name="tree:notes")
                group.create_task(self._follow_limits(limits), name="tree:limits")
                for board in (neighbours, routes):
                    follow = self._follow_reach(board, neighbours, routes)
                    group.create_task(follow, name=f"tree:{board.path}")
                group.create_task(self._report(stats, losses, applications, mission), name="tree:stats")

    def _close(self) -> None:
        self._driver.stop()
        for tap in self._taps.values():
            tap.close()
        self._settings.close()
        self._mirrors.close()
        self._peek.close()

    # -- events of this node

    async def _follow_applications(self, applications: Applications, news: asyncio.Event) -> None:
        while True:
            await news.wait()
            news.clear()
            self._take_applications(applications)

    def _take_applications(self, applications: Applications) -> None:
        table = applications.table
        with self._boundary("applications of the node"):
            self._driver.feed(
                self._tree.on_applications(
                    [resource for entry in table for resource in entry.provides],
                    {pattern for entry in table for pattern in entry.reads},
                    self.module.now_ns(),
                )
            )
            for text, why in self._tree.local_subscriptions.refused.items():
                log.warning("read pattern %s of an application: %s", text, why)

    async def _report(
        self,
        stats: BoardWriter[TreeStats],
        losses: BoardWriter[StreamLosses],
        applications: Applications,
        mission: BoardReader[MissionState],
    ) -> None:
        async for _ in self.module.every(PROBE_S):
            applications.refresh(probe=True)
            state = mission.value
            digest = _digest(state.hash) if state is not None else 0
            if digest != self._mission:
                self._mission = digest
                self._plan.write(self._tree_plan())
            stats.write(self._stats())
            lost = StreamLosses(
                tuple(
                    StreamLoss(path, platform, items)
                    for (path, platform), items in sorted(self._tree.subscribers.losses().items())
                )
            )
            if lost != self._losses:
                self._losses = lost
                losses.write(lost)

    def _stats(self) -> TreeStats:
        tree = self._tree
        return TreeStats(
            len(tree.local.index),
            sum(1 for replica in tree.replicas if replica.index is not None),
            self._asked,
            self._answered,
            len(tree.subscribers.platforms()),
            tree.subscribers.feeds,
            tree.subscribers.notifications,
            tree.subscribers.values,
            self._notes,
            self._values_in,
            tree.subscribers.failures,
            tree.subscribers.dropped,
            self._boundary.refused,
        )

    # -- events of other platforms

    async def _follow_reach(
        self,
        board: BoardReader[Neighbours] | BoardReader[Routes],
        neighbours: BoardReader[Neighbours],
        routes: BoardReader[Routes],
    ) -> None:
        while True:
            await board.changed()
            self._on_reach(reachable(self.module.platform, neighbours.value, routes.value))

    def _on_reach(self, found: dict[str, Reachability]) -> None:
        now_ns = self.module.now_ns()
        before, self._reached = self._reached, found
        for platform in before:
            if platform not in found:
                with self._boundary(f"loss of {platform}"):
                    self._driver.feed(self._tree.on_gone(platform, now_ns))
        for platform, reach in found.items():
            if before.get(platform) != reach:
                with self._boundary(f"reach of {platform}"):
                    self._driver.feed(self._tree.on_up(platform, reach.version, reach.near, now_ns))

    async def _follow_limits(self, board: BoardReader[ChannelLimits]) -> None:
        while True:
            limits = await board.changed()
            with self._boundary("limits of rates"):
                self._driver.feed(self._tree.on_limits(limits.limits, self.module.now_ns()))

    async def _follow_notes(self, notes: Inbox[TreeNotify]) -> None:
        async for note in notes:
            if notes.meta is None or notes.meta.sender_hw != names.hardware_id(note.platform):
                log.warning("notification with the name of %s from another platform; dropped", note.platform)
                continue
            self._notes += 1
            with self._boundary(f"notification of {note.platform}"):
                self._driver.feed(self._tree.on_notify(note, self.module.now_ns()))

    def _on_structure(self, request: StructureRequest, meta: Meta) -> StructureReply:
        _check_sender(request.platform, meta)
        self._answered += 1
        reply, actions = self._tree.on_structure_asked(request, self.module.now_ns())
        self._driver.defer(actions)  # the reply is sent first
        return reply

    def _on_subscribe(self, request: SubscribeRequest, meta: Meta) -> SubscribeReply:
        _check_sender(request.platform, meta)
        self._answered += 1
        reply, actions = self._tree.on_subscribe_asked(request, self.module.now_ns())
        self._driver.defer(actions)
        return reply

    # -- actions

    def _of_action(self, action: Action | None) -> AbstractContextManager[None]:
        match action:
            case None:
                return self._boundary("timer of the tree")
            case WriteMirror(platform, item):
                return self._boundary(f"mirror of /{platform}/{item.path}")
            case _:
                return self._boundary(f"{type(action).__name__} of the tree")

    def _settled(self) -> None:
        """Publish settings and the plan of the beacon if they changed."""
        self._operator_api.on_structures()
        if self._tree.local.index.digest != self._structure:
            self._structure = self._tree.local.index.digest
            with self._boundary("settings of the tree"):
                self._settings.publish(leaf.resource for leaf in self._tree.local.index)
        if self._tree.plan_changed():
            with self._boundary("plan of the beacon"):
                self._plan.write(self._tree_plan())

    def _tree_plan(self) -> TreePlan:
        tree = self._tree
        return TreePlan(
            tree.local.version, tuple(tree.subscribers.offers()), tuple(tree.replicas.wants()), self._mission
        )

    def _perform(self, action: Action) -> None:
        match action:
            case RequestStructure():
                self.module.start(self._ask_structure(action), f"structure of {action.platform}")
            case RequestSubscription():
                self.module.start(self._ask_subscription(action), f"subscription at {action.platform}")
            case SendNotify():
                self.module.start(self._send(action), f"notify {action.platform}")
            case Watch():
                self._watch(action.resource)
            case Unwatch():
                if tap := self._taps.pop(action.path, None):
                    tap.close()
            case WriteMirror(platform, item, epoch):
                self._values_in += self._mirrors.write(platform, item.path, action.frame, epoch=epoch)
            case PruneMirrors():
                self._mirrors.prune(action.platform, action.paths)
            case RemoveMirrors():
                self._mirrors.prune(action.platform, ())

    def _watch(self, resource: Resource) -> None:
        old = self._taps.get(resource.path)
        if old is None or old.resource != resource:
            if old is not None:
                old.close()
            self._taps[resource.path] = Tap(
                self.module.node, resource, self._on_value, self._tree.subscribers.on_overrun
            )

    def _on_value(self, item: TreeItem) -> None:
        with self._boundary(f"value of {item.path}"):
            # deferred: values of one turn of the event loop are sent together
            self._driver.defer(self._tree.on_value(item, self.module.now_ns()))

    async def _ask_structure(self, action: RequestStructure) -> None:
        path, reply = f"/{action.platform}/sys/tree/structure", None
        async with self._at_once:
            self._asked += 1
            try:
                reply = await self.module.request(
                    path, action.request, StructureReply, timeout_s=self.config.answer_s
                )
            except SwarmError as error:
                log.debug("structure of %s: %s", action.platform, error)
        with self._boundary(f"structure of {action.platform}"):
            self._driver.feed(self._tree.on_structure(action.platform, reply, self.module.now_ns()))

    async def _ask_subscription(self, action: RequestSubscription) -> None:
        path, reply = f"/{action.platform}/sys/tree/subscribe", None
        async with self._at_once:
            self._asked += 1
            try:
                reply = await self.module.request(
                    path, action.request, SubscribeReply, timeout_s=self.config.answer_s
                )
            except SwarmError as error:
                log.debug("subscription at %s: %s", action.platform, error)
        with self._boundary(f"subscription at {action.platform}"):
            asked, now_ns = action.request.set_digest, self.module.now_ns()
            self._driver.feed(self._tree.on_subscribed(action.platform, reply, asked, now_ns))

    async def _send(self, action: SendNotify) -> None:
        path = f"/{action.platform}/sys/tree/notify"
        outcome = await self.module.send(
            path, action.notify, timeout_s=self.config.answer_s, kind=action.kind
        )
        now_ns = self.module.now_ns()
        self._driver.feed(self._tree.on_notified(action.platform, action.notify, bool(outcome), now_ns))


def _templates(folder: Path) -> list[tuple[Resource, ...]]:
    """Every valid template: other platforms may have it."""
    found = []
    for name in template.names_in(folder):
        try:
            found.append(template.load(name, folder).resources)
        except ConfigError as error:
            log.warning("invalid template: %s", error)
    return found


def _digest(text: str) -> int:
    """The number of a mission's hash for the beacon; 0 if it is invalid."""
    try:
        return int(text or "0", 16) & 0xFFFF_FFFF
    except ValueError:
        return 0


def _check_sender(platform: str, meta: Meta) -> None:
    if names.hardware_id(platform) != meta.sender_hw:
        raise Denied(f"platform {platform!r}: the request came from another one; expected its own name")
