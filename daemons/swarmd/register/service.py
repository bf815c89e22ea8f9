"""The register's shell: holds the master role, answers who runs where."""

import asyncio

from swarmd.register import config as settings
from swarmd.register.core import RegisterCore
from swarmware import __version__
from swarmware.clock import utc_ns
from swarmware.errors import NoAnswer
from swarmware.master.master import RESOURCE
from swarmware.module import BoardReader, BoardSet, Meta, Module
from swarmware.service import Service
from swarmware.types.net import Routes
from swarmware.types.register import ApplicationTable
from swarmware.types.register import Register as RegisterReply
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo

FORGET_CHECK_S = 10.0
"""How often old platforms are looked for; they are forgotten after minutes."""


class Register(Service):
    """The master by preference; publishing is done by whoever holds the role."""

    name = "register"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        self._routes: BoardReader[Routes] | None = None
        self._core = RegisterCore(node.platform, node.unit, forget_s=config.forget_s)

    async def run(self) -> None:
        """Keeps the role and what others tell until cancelled."""
        module = self.module
        module.provide(RESOURCE)
        await module.serve(
            "sys/register/apps", Empty, self._apps, reply=RegisterReply, description="Who runs where"
        )
        await module.serve("sys/node/info", Empty, self._info, reply=NodeInfo, description="Who this node is")
        self._routes = await module.reader("net/routes", Routes)
        module.node.master.prefer(module.id)
        try:
            if self.config.partners:
                tables = await module.readers(f"/{self.config.partners}/{RESOURCE.path}", ApplicationTable)
                await self._follow(tables)
            await asyncio.Event().wait()
        finally:
            module.node.master.no_longer_prefer()

    async def _follow(self, tables: BoardSet[ApplicationTable]) -> None:
        pause_s = min(FORGET_CHECK_S, self.config.forget_s / 4)
        while True:
            try:
                for platform in await tables.changed(timeout_s=pause_s):
                    table = tables[platform].value
                    if table is not None and table.platform == platform:
                        self._core.on_table(table, self.module.now_ns())
            except NoAnswer:
                pass
            self._hear(tables)
            for platform in self._core.on_timer(self.module.now_ns()):
                self.module.log.info("%s: not heard of for %.0f s, forgotten", platform, self.config.forget_s)

    def _hear(self, tables: BoardSet[ApplicationTable]) -> None:
        """Platforms with a route live, whether their applications change or not."""
        routes = self._routes.value if self._routes is not None else None
        now_ns = self.module.now_ns()
        for route in routes.routes if routes is not None else ():
            if self._core.on_heard(route.platform, now_ns) or route.platform not in tables:
                continue
            table = tables[route.platform].value  # it was forgotten, and is back as it was
            if table is not None and table.platform == route.platform:
                self._core.on_table(table, now_ns)

    def _apps(self, _: Empty, __: Meta) -> RegisterReply:
        own = self.module.node.master.table(full=True)
        routes = self._routes.value if self._routes is not None else None
        hops = {route.platform: route.hops for route in routes.routes} if routes is not None else {}
        return RegisterReply(self._core.units(own, hops, self.module.now_ns()))

    def _info(self, _: Empty, __: Meta) -> NodeInfo:
        node = self.module.node
        names = {app.name for app in node.master.table(full=False).applications}
        return NodeInfo(
            platform=node.platform,
            unit=node.config.unit,
            kind=node.config.kind,
            template=node.config.template,
            version=__version__,
            boot_id=node.clock.boot_id,
            uptime_s=(utc_ns() - node.clock.boot_id) / 1e9,
            services=tuple(sorted(names)),
            config_dir=str(node.config_dir),
            processes=node.config.processes,
        )
