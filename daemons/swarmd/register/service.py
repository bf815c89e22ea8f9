"""The register's shell: holds the master role, and serves the list of applications of all computers."""

import asyncio
from collections.abc import Collection

from swarmd.register import config as settings
from swarmd.register.core.known_registers import (
    Action,
    Forgotten,
    PublishedTable,
    PublishPartners,
    ReachedUnit,
    ReadRoutes,
    RegisterCore,
    Unit,
)
from swarmware import __version__
from swarmware.health.held_condition import HeldCondition
from swarmware.model import names
from swarmware.module.boardset import BoardSet
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.unit_directory import PATH as PARTNERS
from swarmware.node.master.master import RESOURCE
from swarmware.service.service import Service
from swarmware.types.net import Routes, RouteState
from swarmware.types.register import ApplicationTable, PartnerTable, PlatformRemoval, PlatformRemoved
from swarmware.types.register import Register as RegisterReply
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo


class Registrar(Service):
    """Volunteers as master of the node; the current master publishes the table."""

    name = "register"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        self._routes = module.reader("net/routes", Routes)
        patterns = [f"{node.platform}.*"]
        # the main computer publishes under the platform's name as well
        if node.unit != names.MAIN:
            patterns.append(f"{node.platform}.{names.MAIN}")
        if config.partners:
            patterns += [config.partners, f"{config.partners}.*"]
        self._tables = [
            module.readers(f"/{pattern}/{RESOURCE.path}", ApplicationTable) for pattern in patterns
        ]
        """Tables of the other computers of this platform, and of the configured partner platforms."""
        self._core = RegisterCore(node.platform, node.unit, config)
        if (known := module.reader(PARTNERS, PartnerTable).value) is not None:
            self._core.restore(known, module.now_ns())
        self._partners = module.writer(
            PARTNERS,
            PartnerTable,
            link="request",
            description="Other computers and their applications",
        )
        # the next process of the register continues with this board
        self._partners.durable = True
        self._applications = HeldCondition(
            self.health, "applications", "Application files of this node, and the addresses that they claim"
        )
        self._driver = self.drive(self._core, self._perform)
        module.provide(RESOURCE)
        module.serve(
            "sys/register/apps",
            Empty,
            self._apps,
            reply=RegisterReply,
            description="Applications of all units",
        )
        module.serve(
            "sys/register/forget",
            PlatformRemoval,
            self._forget,
            reply=PlatformRemoved,
            description="Removes the applications of a platform that has left the swarm",
        )
        module.serve(
            "sys/node/info",
            Empty,
            self._info,
            reply=NodeInfo,
            description="Identity and versions of this node",
        )

    async def run(self) -> None:
        """Holds the master role and keeps the tables of other computers until cancelled."""
        module = self.module
        module.node.master.on_rejections = self._on_rejections
        module.node.master.volunteer(module.id)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._driver.run(), name="register: driver")
                for tables in self._tables:
                    group.create_task(self._follow(tables), name=f"register: {tables.pattern}")
        finally:
            module.node.master.on_rejections = None
            self._applications.close()
            # another application of the node then becomes master
            module.node.master.step_back()

    def _on_rejections(self, rejections: tuple[str, ...]) -> None:
        """Reports the invalid application files of this node as a fault."""
        if rejections:
            self._applications.raise_fault("refused", "warn", "; ".join(rejections))
        else:
            self._applications.clear()

    async def _follow(self, tables: BoardSet[ApplicationTable]) -> None:
        while True:
            for name in await tables.changed():
                now_ns = self.module.now_ns()
                if (published := _published(tables, name, now_ns)) is not None:
                    self._driver.feed(self._core.on_table(published, now_ns))

    def _perform(self, action: Action) -> None:
        match action:
            case ReadRoutes():
                now_ns = self.module.now_ns()
                self._driver.feed(self._core.on_routes_read(self._reached(now_ns), now_ns))
            case PublishPartners(table):
                self._partners.write(table)
            case Forgotten(platform):
                self.module.log.info("%s: not reachable for %.0f s, removed", platform, self.config.forget_s)

    def _reached(self, now_ns: int) -> dict[Unit, ReachedUnit]:
        """Computers with a route, and the tables that they publish."""
        routes = self._routes.value
        found = routes.routes if routes is not None else ()
        return {
            (route.platform, route.unit): ReachedUnit(route.hops, self._table_of(route, now_ns))
            for route in found
        }

    def _table_of(self, route: RouteState, now_ns: int) -> PublishedTable | None:
        # a main computer publishes under one of two names, by its configuration
        for name in (route.name, f"{route.platform}.{route.unit}"):
            for tables in self._tables:
                if name in tables and (found := _published(tables, name, now_ns)) is not None:
                    return found
        return None

    def _apps(self, _: Empty, __: Meta) -> RegisterReply:
        own = self.module.node.master.table(full=True)
        routes = self._routes.value
        hops = {(route.platform, route.unit): route.hops for route in routes.routes} if routes else {}
        return RegisterReply(self._core.units(own, hops, self.module.now_ns()))

    def _forget(self, request: PlatformRemoval, _: Meta) -> PlatformRemoved:
        known, actions = self._core.on_removal(request.platform, self.module.now_ns())
        self._driver.feed(actions)
        return PlatformRemoved(known)

    def _info(self, _: Empty, __: Meta) -> NodeInfo:
        node = self.module.node
        table = node.master.table(full=False)
        return NodeInfo(
            platform=node.platform,
            unit=node.config.unit,
            kind=node.config.kind,
            template=node.config.template,
            version=__version__,
            boot_id=node.clock.boot_id,
            uptime_s=node.uptime_s,
            services=tuple(sorted({app.name for app in table.applications})),
            config_dir=str(node.config_dir),
            processes=processes(table, node.config.services),
        )


def processes(table: ApplicationTable, services: Collection[str]) -> str:
    """Returns `one` if the running services of a node share a process, else `per-daemon`."""
    pids = {app.pid for app in table.applications if app.name in services}
    return "one" if len(pids) <= 1 else "per-daemon"


def _published(tables: BoardSet[ApplicationTable], name: str, now_ns: int) -> PublishedTable | None:
    """The table of a platform or computer, or None if the table names another computer."""
    board = tables[name]
    table = board.value
    # a platform must not publish applications in the name of another one
    if table is None or name not in {table.platform, f"{table.platform}.{table.unit}"}:
        return None
    return PublishedTable(table, now_ns - round((board.age_s or 0.0) * 1e9))
