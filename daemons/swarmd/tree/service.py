"""The tree's shell: feeds the core with events, and executes its actions."""

import asyncio
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

from swarmd.tree import config as own
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
from swarmd.tree.core.replicas.number_watch import NumberWatch
from swarmd.tree.core.tree import Reachability, SwarmTree, reachable
from swarmd.tree.exchange.boundary import Boundary
from swarmd.tree.exchange.mirrors import Mirrors
from swarmd.tree.exchange.placement import PlacementMeasurement
from swarmd.tree.exchange.taps import Peek, Tap
from swarmd.tree.exchange.tree_exchange import TreeExchange
from swarmd.tree.operator.config_api import ConfigApi
from swarmd.tree.operator.operator_api import OperatorApi
from swarmd.tree.operator.rule_api import RuleApi
from swarmd.tree.operator.tree_view import TreeView
from swarmd.tree.operator.unit_forwarder import UnitForwarder
from swarmd.tree.records import change_log
from swarmd.tree.records.change_log import ChangeLog
from swarmd.tree.records.denial_log import DenialLog
from swarmd.tree.records.report import TreeReport
from swarmd.tree.settings import rule_store
from swarmd.tree.settings.rule_store import RuleStore
from swarmd.tree.settings.settings import Settings
from swarmd.tree.settings.store import SettingsStore
from swarmware.errors import ConfigError
from swarmware.model import names, paths, template
from swarmware.model.resource import Resource
from swarmware.model.stored_setting import FILE
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.service.service import Service
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types.channel import ChannelLimits
from swarmware.types.health import OK_STATE
from swarmware.types.mission import MissionState
from swarmware.types.net import Neighbours, Routes, StructureBroadcast, TreePlan
from swarmware.types.tree import TreeChange
from swarmware.types.tree_exchange import TreeItem

PROBE_S: Final = 1.0
"""Period of looking for applications that died without leaving."""

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
        node.access_rules.check()
        access = node.access_rules.access
        self._access_version = node.access_rules.version
        files: dict[Path, template.TemplateFile] = {}
        self._tree = SwarmTree(
            str(node.address),
            template.load(node.config.template, folder, files).resources,
            config,
            # never 0, which stands for an unknown epoch
            epoch=int.from_bytes(os.urandom(4)) // 2 + 1,
            templates=_templates(folder, files),
            keep=config.kept(node.config.kind),
            access=access,
        )
        self._boundary = Boundary()
        self._driver = self.drive(self._tree, self._perform, settled=self._settled, boundary=self._of_action)
        self._stepped = asyncio.Event()
        """Set after each step of the core."""
        self._settings = Settings(module, SettingsStore(node.config.data_path / FILE))
        self._structure = 0
        """Digest of the structure whose settings are published."""
        self._mirrors = Mirrors(node)
        self._taps: dict[str, Tap] = {}
        self._values: list[TreeItem] = []
        """Values of watched resources that the core takes next."""
        self._peek = Peek(node.shm_dir)
        self._exchange = TreeExchange(module, self._tree, self._driver, self._boundary, config.answer_s)
        changes: BoardWriter[TreeChange] = module.stream_writer(
            "tree/changes", TreeChange, kind="event", link="request", log="all"
        )
        self._changes = ChangeLog(module, changes, node.config.data_path / change_log.FILE)
        self._denials = DenialLog(module, self._changes)
        rules = RuleStore(node.config.data_path / rule_store.FILE)
        self._driver.defer(self._tree.on_rules(rules.rules, module.now_ns()))
        view = TreeView(self._tree, self._peek, module.now_ns, module.remote_clocks.to_local)
        self._operator_api = OperatorApi(
            module,
            self._tree,
            self._driver,
            self._stepped,
            UnitForwarder(module, view, config.answer_s),
            self._settings,
            self._changes,
            self._denials,
        )
        self._rule_api = RuleApi(module, self._tree, self._driver, rules, self._changes, self._denials)
        self._config_api = ConfigApi(module, self._settings)
        self._placement = PlacementMeasurement(module, self._tree, self._exchange)
        self._report = TreeReport(
            module, self._tree, self._exchange, self._mirrors, self._boundary, self._denials
        )
        self._plan: BoardWriter[TreePlan] = module.writer("tree/plan", TreePlan, link="request")
        self._mission: BoardReader[MissionState] = module.reader("mission/state", MissionState)
        self._mission_digest = 0
        """Digest of the mission that the beacon has."""
        self._numbers = NumberWatch(self._tree.local, self._tree.replicas)
        self._clashes: list[str] = []
        """Clashes of numbers that the health check has reported."""
        self._limits: BoardReader[ChannelLimits] = module.reader("net/limits", ChannelLimits)
        self._neighbours: BoardReader[Neighbours] = module.reader("net/neighbours", Neighbours)
        self._routes: BoardReader[Routes] = module.reader("net/routes", Routes)
        self._structures = module.stream_reader("net/structures", StructureBroadcast)
        self._reached: dict[str, Reachability] = {}
        """Platforms that the core was last fed as reachable."""

    async def run(self) -> None:
        """Serve requests, replicate and mirror until cancelled."""
        changed = asyncio.Event()
        subscription = self.module.node.applications.subscribe(lambda _: changed.set())
        try:
            # mirrors of platforms that never return must expire as well
            for platform in self._mirrors.platforms():
                self._driver.feed(self._tree.on_former_mirrors(platform, self.module.now_ns()))
            # before the first reply: others must not receive a tree without its applications
            self._take_applications()
            self._exchange.serve()
            self._operator_api.serve()
            self._rule_api.serve()
            self._config_api.serve()
            self._placement.serve()
            self._changes.serve()
            self._report.serve()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._driver.run(), name="tree:driver")
                group.create_task(self._follow_applications(changed), name="tree:apps")
                group.create_task(self._exchange.follow_notifications(), name="tree:notes")
                group.create_task(self._follow_limits(), name="tree:limits")
                group.create_task(self._follow_structures(), name="tree:structures")
                group.create_task(self._changes.follow_broker(), name="tree:changes of channels")
                group.create_task(self._denials.follow_broker(), name="tree:denials of the broker")
                group.create_task(self._denials.follow_processes(), name="tree:denials of processes")
                for board in (self._neighbours, self._routes):
                    group.create_task(self._follow_reach(board), name=f"tree:{board.path}")
                group.create_task(self._report_regularly(), name="tree:stats")
        finally:
            subscription.close()
            self._close()

    def _close(self) -> None:
        self._driver.stop()
        for tap in self._taps.values():
            tap.close()
        self._denials.close()
        self._settings.close()
        self._mirrors.close()
        self._peek.close()

    # -- events of this node

    async def _follow_applications(self, changed: asyncio.Event) -> None:
        while True:
            await changed.wait()
            changed.clear()
            self._take_applications()

    def _take_applications(self) -> None:
        table = self.module.node.applications.table
        # settings first: the step of the core publishes them, with the values of the applications' files
        with self._boundary("settings of the applications"):
            self._settings.on_applications(table)
        with self._boundary("applications of the node"):
            self._driver.feed(
                self._tree.on_applications(
                    [*self._unit_settings(table), *(one for entry in table for one in entry.provides)],
                    {pattern for entry in table for pattern in entry.reads},
                    self.module.now_ns(),
                )
            )
            for text, why in self._tree.local_subscriptions.refused.items():
                log.warning("read pattern %s of an application: %s", text, why)

    def _unit_settings(self, table: Iterable[AppEntry]) -> Iterator[Resource]:
        """Settings of the template that applications of this computer use; `main` keeps the others."""
        if self._tree.address.unit == names.MAIN:
            return
        for entry in table:
            for name in entry.live.values():
                setting = self._tree.local.setting(paths.setting(name), entry.name)
                if setting is not None:
                    yield setting

    async def _report_regularly(self) -> None:
        async for _ in self.module.every(PROBE_S):
            # an application that was killed has removed no file, so only its lock shows the end
            self.module.node.applications.refresh(probe=True)
            self._take_access_rules()
            with self._boundary("mirrors that the broker has left"):
                self._mirrors.retry()
            state = self._mission.value
            digest = _digest(state.hash) if state is not None else 0
            # the core does not know the mission, so `plan_changed` does not report its change
            if digest != self._mission_digest:
                self._mission_digest = digest
                self._plan.write(self._tree_plan())
            with self._boundary("numbers of paths in frames"):
                self._report_clashes()
            self._report.write()

    def _report_clashes(self) -> None:
        found = self._numbers.texts()
        if found != self._clashes:
            self._clashes = found
            self.health.report(
                "numbers",
                "clash" if found else OK_STATE,
                detail="; ".join(found),
                description="Paths have different numbers in frames",
            )

    def _take_access_rules(self) -> None:
        rules = self.module.node.access_rules
        if rules.version != self._access_version:
            self._access_version = rules.version
            with self._boundary("access rules"):
                self._driver.feed(self._tree.on_access(self.module.now_ns()))

    # -- events of the broker

    async def _follow_reach(self, board: BoardReader[Neighbours] | BoardReader[Routes]) -> None:
        while True:
            await board.changed()
            self._on_reach(reachable(str(self._tree.address), self._neighbours.value, self._routes.value))

    def _on_reach(self, found: dict[str, Reachability]) -> None:
        now_ns = self.module.now_ns()
        before, self._reached = self._reached, found
        by_multicast = frozenset(platform for platform, reach in found.items() if reach.multicast)
        # before the platforms: `on_up` decides by it whether to wait for a beacon or to request
        self._driver.feed(self._tree.on_multicast(by_multicast, now_ns))
        for platform in before:
            if platform not in found:
                with self._boundary(f"loss of {platform}"):
                    self._driver.feed(self._tree.on_gone(platform, now_ns))
        for platform, reach in found.items():
            if before.get(platform) != reach:
                with self._boundary(f"reach of {platform}"):
                    self._driver.feed(self._tree.on_up(platform, reach.version, reach.near, now_ns))

    async def _follow_structures(self) -> None:
        async for broadcast in self._structures:
            with self._boundary(f"structure of {broadcast.node}"):
                self._driver.feed(self._tree.on_broadcast(broadcast, self.module.now_ns()))

    async def _follow_limits(self) -> None:
        while True:
            limits = await self._limits.changed()
            with self._boundary("limits of rates"):
                self._driver.feed(self._tree.on_limits(limits.limits, self.module.now_ns()))

    # -- actions

    def _of_action(self, action: Action | None) -> AbstractContextManager[None]:
        match action:
            case None:
                return self._boundary("timer of the tree")
            case WriteMirror(platform, item, _, _):
                return self._boundary(f"mirror of /{platform}/{item.path}")
            case _:
                return self._boundary(f"{type(action).__name__} of the tree")

    def _settled(self) -> None:
        """Publish settings and the plan of the beacon if they changed."""
        self._stepped.set()
        if self._tree.local.index.digest != self._structure:
            self._structure = self._tree.local.index.digest
            with self._boundary("settings of the tree"):
                self._settings.publish(leaf.resource for leaf in self._tree.local.index)
        if self._tree.plan_changed():
            with self._boundary("plan of the beacon"):
                plan = self._tree_plan()
                # before the broker reads the plan: two writers of one ring exclude each other
                self._mirrors.leave(plan.wants)
                self._plan.write(plan)

    def _tree_plan(self) -> TreePlan:
        tree = self._tree
        return TreePlan(
            tree.local.version,
            tuple(tree.subscribers.offers()),
            tuple(tree.replicas.wants()),
            self._mission_digest,
            tree.broadcast(),
            tuple(tree.replicas.needs()),
        )

    def _perform(self, action: Action) -> None:
        start, exchange = self.module.start, self._exchange
        match action:
            case RequestStructure():
                start(exchange.ask_structure(action), f"structure of {action.platform}")
            case RequestSubscription():
                start(exchange.ask_subscription(action), f"subscription at {action.platform}")
            case SendNotify():
                start(exchange.send(action), f"notify {action.platform}")
            case Watch():
                self._watch(action.resource)
            case Unwatch():
                if tap := self._taps.pop(action.path, None):
                    tap.close()
            case WriteMirror():
                self._mirrors.write(action)
            case PruneMirrors():
                self._mirrors.prune(action.platform, action.paths)
            case RemoveMirrors():
                self._mirrors.prune(action.platform, ())

    def _watch(self, resource: Resource) -> None:
        old = self._taps.get(resource.path)
        # a new tap starts with events from now on, so an unchanged resource keeps its tap
        if old is None or old.resource != resource:
            if old is not None:
                old.close()
            self._taps[resource.path] = Tap(
                self.module.node, resource, self._on_value, self._tree.subscribers.on_overrun
            )

    def _on_value(self, item: TreeItem) -> None:
        if not self._values:
            # later: the values of one turn of the event loop share a notification and its acknowledgement
            asyncio.get_running_loop().call_soon(self._take_values)
        self._values.append(item)

    def _take_values(self) -> None:
        values, self._values = self._values, []
        with self._boundary("values of this node"):
            self._driver.feed(self._tree.on_values(values, self.module.now_ns()))


def _templates(folder: Path, files: dict[Path, template.TemplateFile]) -> list[tuple[Resource, ...]]:
    """Every valid template: other platforms may have it."""
    found = []
    for name in template.names_in(folder):
        try:
            # a template with an error is left out: the own one was loaded before, with its error raised
            found.append(template.load(name, folder, files).resources)
        except ConfigError as error:
            log.warning("invalid template: %s", error)
    return found


def _digest(text: str) -> int:
    """The number of a mission's hash for the beacon, or 0 if it is invalid."""
    try:
        return int(text or "0", 16) & 0xFFFF_FFFF
    except ValueError:
        return 0
