"""The tree's shell: tells the core what happens, carries out what comes back."""

import asyncio
import contextlib
import logging
import secrets
from pathlib import Path
from typing import Final

from swarmd.tree import config as own
from swarmd.tree.answers import Answers
from swarmd.tree.applications import Applications
from swarmd.tree.boundary import Boundary
from swarmd.tree.core.action import (
    Action,
    AskStructure,
    AskSubscription,
    Forget,
    KeepOnly,
    SendNotify,
    Unwatch,
    Watch,
)
from swarmd.tree.core.lane import WINDOW
from swarmd.tree.core.reach import Reach, reachable
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.mirrors import Mirrors
from swarmd.tree.settings import Settings
from swarmd.tree.store import Store
from swarmd.tree.taps import Peek, Tap
from swarmware import names, template
from swarmware.errors import ConfigError, Denied, SwarmError
from swarmware.module import BoardReader, BoardWriter, Inbox, Meta, Module
from swarmware.resource import Resource
from swarmware.service import Service
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
"""How often applications that died without a word are looked for."""
AT_ONCE: Final = 32
"""Requests to other trees on their way at the same time: a large swarm is met at once, not asked at once."""

log = logging.getLogger("swarm.tree")


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
            epoch=secrets.randbits(31) + 1,
            limits=config.limits(),
            templates=_templates(folder),
            rules=[rule.rule() for rule in config.rules],
            keep=config.kept(node.config.kind),
        )
        self._peek = Peek(node.shm_dir)
        self._mirrors = Mirrors(node)
        self._settings = Settings(module, Store(node.config.data_path / "settings.toml"))
        self._taps: dict[str, Tap] = {}
        self._reached: dict[str, Reach] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._act_comes = False
        self._closed = False
        self._boundary = Boundary()
        self._losses = StreamLosses()
        self._at_once = asyncio.Semaphore(AT_ONCE)
        self._mission = 0
        self._asked = self._answered = self._notes = self._values_in = 0

    async def run(self) -> None:
        """Serves, follows and mirrors until cancelled."""
        module = self.module
        with contextlib.ExitStack() as stack:
            stack.callback(self._close)
            self._plan: BoardWriter[TreePlan] = await module.writer("tree/plan", TreePlan, link="request")
            stats = await module.writer("tree/stats", TreeStats, rate_hz=1.0, link="request")
            losses = await module.writer("tree/losses", StreamLosses, link="request")
            losses.write(self._losses)
            changes = await module.writer("tree/changes", TreeChange, kind="event", link="request", log="all")
            notes = await module.inbox("sys/tree/notify", TreeNotify, limit=4 * WINDOW)
            neighbours = await module.reader("net/neighbours", Neighbours)
            routes = await module.reader("net/routes", Routes)
            mission = await module.reader("mission/state", MissionState)
            limits = await module.reader("net/limits", ChannelLimits)
            news = asyncio.Event()
            applications = Applications(module.node, news.set)
            stack.callback(applications.close)
            for platform in self._mirrors.platforms():
                self._tree.remotes.on_left_behind(platform, module.now_ns())
            # before the first answer: others must not be told of a tree without its applications
            self._take_applications(applications)
            await module.serve(
                "sys/tree/structure", StructureRequest, self._on_structure, reply=StructureReply
            )
            await module.serve(
                "sys/tree/subscribe", SubscribeRequest, self._on_subscribe, reply=SubscribeReply
            )
            self._answers = Answers(
                module, self._tree, self._settings, self._peek, applications, changes, self.config.answer_s
            )
            await self._answers.serve(self._act)
            async with asyncio.TaskGroup() as group:
                group.create_task(self._follow_applications(applications, news), name="tree:apps")
                group.create_task(self._follow_notes(notes), name="tree:notes")
                group.create_task(self._follow_limits(limits), name="tree:limits")
                for board in (neighbours, routes):
                    follow = self._follow_reach(board, neighbours, routes)
                    group.create_task(follow, name=f"tree:{board.path}")
                group.create_task(self._report(stats, losses, applications, mission), name="tree:stats")

    def _close(self) -> None:
        self._closed = True
        for tap in self._taps.values():
            tap.close()
        if self._timer is not None:
            self._timer.cancel()
        self._settings.close()
        self._mirrors.close()
        self._peek.close()

    # -- what happens here

    async def _follow_applications(self, applications: Applications, news: asyncio.Event) -> None:
        while True:
            await news.wait()
            news.clear()
            self._take_applications(applications)

    def _take_applications(self, applications: Applications) -> None:
        table = applications.table
        with self._boundary("applications of the node"):
            self._tree.set_applications(
                [resource for entry in table for resource in entry.provides],
                {pattern for entry in table for pattern in entry.reads},
                self.module.now_ns(),
            )
            for text, why in self._tree.interests.refused.items():
                log.warning("an application wants to read %s: %s", text, why)
            self._structure_changed()
        self._act()

    def _structure_changed(self) -> None:
        self._settings.publish(leaf.resource for leaf in self._tree.local.index)

    async def _report(
        self,
        stats: BoardWriter[TreeStats],
        losses: BoardWriter[StreamLosses],
        applications: Applications,
        mission: BoardReader[MissionState],
    ) -> None:
        async for _ in self.module.every(PROBE_S):
            applications.probe()
            state = mission.value
            digest = _digest(state.hash) if state is not None else 0
            if digest != self._mission:
                self._mission = digest
                self._plan.write(self._tree_plan())
            stats.write(self._stats())
            lost = StreamLosses(
                tuple(
                    StreamLoss(path, platform, items)
                    for (path, platform), items in sorted(self._tree.held.losses().items())
                )
            )
            if lost != self._losses:
                self._losses = lost
                losses.write(lost)

    def _stats(self) -> TreeStats:
        tree = self._tree
        return TreeStats(
            len(tree.local.index),
            sum(1 for remote in tree.remotes if remote.index is not None),
            self._asked,
            self._answered,
            len(tree.held.subscribers()),
            tree.held.feeds,
            tree.held.notifications,
            tree.held.values,
            self._notes,
            self._values_in,
            tree.held.failures,
            tree.held.dropped,
            self._boundary.refused,
        )

    # -- what others do

    async def _follow_reach(
        self,
        board: BoardReader[Neighbours] | BoardReader[Routes],
        neighbours: BoardReader[Neighbours],
        routes: BoardReader[Routes],
    ) -> None:
        while True:
            await board.changed()
            self._on_reach(reachable(self.module.platform, neighbours.value, routes.value))

    def _on_reach(self, found: dict[str, Reach]) -> None:
        now_ns = self.module.now_ns()
        before, self._reached = self._reached, found
        for platform in before:
            if platform not in found:
                with self._boundary(f"loss of {platform}"):
                    self._tree.on_gone(platform, now_ns)
        for platform, reach in found.items():
            if before.get(platform) != reach:
                with self._boundary(f"reach of {platform}"):
                    self._tree.on_up(platform, reach.version, reach.near, now_ns)
        self._act()

    async def _follow_limits(self, board: BoardReader[ChannelLimits]) -> None:
        while True:
            limits = await board.changed()
            with self._boundary("limits of rates"):
                self._tree.held.set_limits(limits.limits, self.module.now_ns())
            self._act()

    async def _follow_notes(self, notes: Inbox[TreeNotify]) -> None:
        async for note in notes:
            if notes.meta is None or notes.meta.sender_hw != names.hardware_id(note.platform):
                log.warning("a notification in the name of %s came from another; dropped", note.platform)
                continue
            self._notes += 1
            items: list[TreeItem] = []
            with self._boundary(f"notification of {note.platform}"):
                items = self._tree.on_notify(note, self.module.now_ns())
            for item in items:
                with self._boundary(f"mirror of /{note.platform}/{item.path}"):
                    self._values_in += self._mirrors.write(note.platform, item)
            self._answers.learned()
            self._act()

    def _on_structure(self, request: StructureRequest, meta: Meta) -> StructureReply:
        _check_sender(request.platform, meta)
        self._answered += 1
        reply = self._tree.on_structure_asked(request)
        self._later()
        return reply

    def _on_subscribe(self, request: SubscribeRequest, meta: Meta) -> SubscribeReply:
        _check_sender(request.platform, meta)
        self._answered += 1
        reply = self._tree.on_subscribe_asked(request, self.module.now_ns())
        self._later()
        return reply

    def _later(self) -> None:
        """Act in a turn of its own: an answer goes out first, values that come together go together."""
        if not self._act_comes:
            self._act_comes = True
            asyncio.get_running_loop().call_soon(self._act)

    # -- what the core wants

    def _act(self) -> None:
        self._act_comes = False
        if self._closed:
            return
        while actions := self._tree.drain():
            for action in actions:
                with self._boundary(f"{type(action).__name__} of the tree"):
                    self._do(action)
        if self._tree.plan_changed():
            with self._boundary("plan of the tick"):
                self._plan.write(self._tree_plan())
        self._arm()

    def _tree_plan(self) -> TreePlan:
        tree = self._tree
        return TreePlan(
            tree.local.version, tuple(tree.held.offers()), tuple(tree.remotes.wants()), self._mission
        )

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
            case KeepOnly():
                self._mirrors.keep_only(action.platform, action.paths)
            case Forget():
                self._mirrors.forget(action.platform)

    def _watch(self, resource: Resource) -> None:
        old = self._taps.get(resource.path)
        if old is None or old.resource != resource:
            if old is not None:
                old.close()
            self._taps[resource.path] = Tap(
                self.module.node, resource, self._on_value, self._tree.held.on_overrun
            )

    def _on_value(self, item: TreeItem) -> None:
        with self._boundary(f"value of {item.path}"):
            self._tree.on_value(item, self.module.now_ns())
        self._later()

    async def _ask_structure(self, action: AskStructure) -> None:
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
            self._tree.on_structure(action.platform, reply, self.module.now_ns())
        self._answers.learned()
        self._act()

    async def _ask_subscription(self, action: AskSubscription) -> None:
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
            self._tree.on_subscribed(action.platform, reply, action.request.set_digest, self.module.now_ns())
        self._act()

    async def _send(self, action: SendNotify) -> None:
        path = f"/{action.platform}/sys/tree/notify"
        outcome = await self.module.send(
            path, action.notify, timeout_s=self.config.answer_s, kind=action.kind
        )
        self._tree.on_notified(action.platform, action.notify, bool(outcome), self.module.now_ns())
        self._act()

    # -- time

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        deadline_ns = self._tree.deadline_ns()
        if deadline_ns is not None:
            # never earlier: a timer that fires a moment before the deadline would fire again and again
            wait_s = max(0.0, (deadline_ns - self.module.now_ns()) / 1e9) + 0.001
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        with self._boundary("timer of the tree"):
            self._tree.on_timer(self.module.now_ns())
            self._structure_changed()
        self._act()


def _templates(folder: Path) -> list[tuple[Resource, ...]]:
    """Every template that can be read: what other platforms may be made of."""
    found = []
    for name in template.names_in(folder):
        try:
            found.append(template.load(name, folder).resources)
        except ConfigError as error:
            log.warning("a template that is of no use here: %s", error)
    return found


def _digest(text: str) -> int:
    """The number of a mission's hash for the hello; 0 for what is none."""
    try:
        return int(text or "0", 16) & 0xFFFF_FFFF
    except ValueError:
        return 0


def _check_sender(platform: str, meta: Meta) -> None:
    if names.hardware_id(platform) != meta.sender_hw:
        raise Denied(f"platform {platform!r}: the request came from another one; expected its own name")
