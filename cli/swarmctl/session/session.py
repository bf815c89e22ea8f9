"""A session with the swarm: finds a node of this machine and joins it as a module named swarmctl."""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from copy import copy
from pathlib import Path
from typing import Concatenate, Final, ParamSpec, Self, TypeVar

import msgspec

from swarmctl.commandline.nodes import NodeSelection, is_selection, names_one
from swarmctl.commandline.settings import CliSettings
from swarmctl.terminal.confirmation import JointConfirmation, confirm
from swarmctl.terminal.output import Output
from swarmware.errors import Denied, NoAnswer, NotFound, SwarmError
from swarmware.model import names
from swarmware.model.config import CONFIG_VARIABLE, DEFAULT_DIR, load_node
from swarmware.module.client import Client
from swarmware.transport.appfile.table import populated
from swarmware.transport.delivery.outcome import ABSENT
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty
from swarmware.types.tree import TreeList, TreeListing

R = TypeVar("R", bound=msgspec.Struct)
T = TypeVar("T")
P = ParamSpec("P")

NAME: Final = "swarmctl"
OPTIONAL_SERVICES: Final = frozenset({"files", "video"})
"""Services that a node runs only if its node.toml lists them, by the name in their addresses."""


class Session:
    """Access of a command to the swarm: the joined node, the addressed platform, the output."""

    def __init__(self, module: Client, settings: CliSettings, out: Output) -> None:
        self.module = module
        self.settings = settings
        self.out = out
        self.here = module.platform
        """Platform of the node that was joined."""
        self.selection = NodeSelection(settings.node or self.here)
        self.platform = "" if is_selection(settings.node) else settings.node or self.here
        """Platform of `--node`, else the joined one, or "" if the selection may name several."""
        self._joint: JointConfirmation | None = None
        self._routes: Routes | None = None
        self._known: tuple[str, ...] = ()
        self.classes: dict[tuple[str, str], type[msgspec.Struct] | None] = {}
        """Payload types that are not installed here, by platform and name, or None without a description."""

    def at(self, platform: str, out: Output, joint: JointConfirmation) -> Self:
        """This session for one of the selected nodes, which share one confirmation."""
        # a shallow copy, so that routes and types which one node has requested serve the next
        one = copy(self)
        one.settings = self.settings._replace(node=platform)
        one.selection = NodeSelection(platform)
        one.platform = platform
        one.out = out
        one._joint = joint
        return one

    @property
    def joint(self) -> bool:
        """Whether the command runs at the same time for other nodes."""
        return self._joint is not None

    def path(self, path: str) -> str:
        """A path with its platform, such as `/uav1/nav/pose` for `-n uav1`, or a pattern for several."""
        platform, local = names.split(path)
        return names.join(platform or self.selection.pattern, local)

    async def check_selected(self, path: str) -> None:
        """Check that each name and pattern of the selection matches a platform, unless the path has its own.

        Raises: NotFound naming the known platforms.
        """
        if is_selection(self.settings.node) and not path.startswith("/"):
            await self.selected()

    async def confirm(self, yes: bool, what: str) -> None:
        """Returns when the operator confirms what happens at this platform; once for all selected ones.

        `what`: effect to confirm, or "" if this platform needs no confirmation and waits for the others.
        Raises: UsageError without a terminal, Abort after a refusal.
        """
        if self._joint is None:
            confirm(yes or not what, f"{self.platform}: {what}")
        else:
            await self._joint.confirm(yes, self.platform, what)

    async def others_ended(self) -> None:
        """Returns when the command has ended at the other selected nodes."""
        if self._joint is not None:
            await self._joint.others_ended()

    async def platforms(self) -> list[str]:
        """The joined node, every platform that it can reach, and known but unreachable platforms.

        Raises: NoAnswer when its broker does not answer.
        """
        ways = {route.platform for route in (await self.routes()).routes}
        return sorted({self.here, *ways, *await self.known()}, key=names.natural)

    async def selected(self) -> list[str]:
        """The selected platforms, or all known ones without a selection. A single name is not checked.

        Raises: NotFound when a name or a pattern matches none.
        """
        if names_one(self.settings.node):
            return [self.platform]
        known = await self.platforms()
        return self.selection.choose(known, self.here) if self.settings.node else known

    async def ask(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        about: str = "",
        timeout_s: float | None = None,
    ) -> R:
        """Sends a request to the platform of the session, or to the one in the path.

        `about`: resource of another platform to which the request will be forwarded.
        Raises: as `Client.request`.
        """
        wait_s = self.settings.timeout_s if timeout_s is None else timeout_s
        full = self.path(path)
        platform = names.split(about or full)[0] or self.here
        await self.reach(platform)
        try:
            return await self.module.request(full, value, reply, timeout_s=wait_s)
        except NoAnswer as error:
            raise NoAnswer(f"{about or full}: {platform} does not answer ({error})") from error
        except NotFound as error:
            service = names.split(full)[1].removeprefix("sys/").partition("/")[0]
            # for other services absence is a fault of the node, which a hint to node.toml would hide
            if ABSENT not in str(error) or service not in OPTIONAL_SERVICES:
                raise
            text = f"{platform}: the service `{service}` does not run there; expected it in node.toml"
            raise NotFound(f"{text} ({error})") from error

    def age_s(self, platform: str, stamp_ns: int) -> float | None:
        """Age of a stamp on a platform's clock, or None if the joined node does not know that clock."""
        local_ns = self.module.remote_clocks.to_local(names.hardware_id(platform), stamp_ns)
        return None if local_ns is None else (self.module.now_ns() - local_ns) / 1e9

    def renew(self) -> None:
        """Asks for routes and known platforms again at their next use."""
        self._routes, self._known = None, ()

    async def routes(self) -> Routes:
        """Routes of the joined node; requested once.

        Raises: as `Client.request`.
        """
        if self._routes is None:
            path, wait_s = names.join(self.here, "sys/broker/routes"), self.settings.timeout_s
            self._routes = await self.module.request(path, Empty(), Routes, timeout_s=wait_s)
        return self._routes

    async def other_computers(self, platform: str) -> list[str]:
        """Addresses of the computers of a platform beside `main`, or none if `platform` names one.

        Raises: as `routes`.
        """
        if platform != names.platform_of(platform):
            return []
        known = [names.Address(route.platform, route.unit) for route in (await self.routes()).routes]
        known.append(self.module.node.address)
        found = {one.path for one in known if one.platform == platform and one.unit != names.MAIN}
        return sorted(found)

    async def reach(self, platform: str) -> None:
        """Checks that a platform is known and has a route, so that a request need not run into a time-out.

        Raises: NotFound for an unknown platform, NoAnswer for one without a route.
        """
        if not await self.in_reach(platform):
            raise NoAnswer(f"node {platform!r}: known, but {self.here} has no route to it now")

    async def in_reach(self, platform: str) -> bool:
        """Whether a known platform has a route now.

        Raises: NotFound for an unknown platform.
        """
        platform = names.platform_of(names.check_computer(platform))
        if platform == self.here:
            return True
        ways = {route.platform for route in (await self.routes()).routes}
        known = () if platform in ways else await self.known()
        if platform in ways or platform in known:
            return platform in ways
        there = ", ".join(sorted({self.here, *ways, *known}, key=names.natural))
        raise NotFound(f"node {platform!r}: not known to {self.here}; expected one of {there}")

    async def known(self) -> tuple[str, ...]:
        """All platforms whose tree is known here, even if unreachable, or none without a tree service."""
        if not self._known:
            # every list names the known platforms, so a pattern without a match is enough
            path, nothing = names.join(self.here, "sys/tree/list"), TreeList(f"/{self.here}/none", 1)
            try:
                # a local answer takes milliseconds; a longer wait would delay every command on a node
                # without a tree
                found = await self.module.request(path, nothing, TreeListing, timeout_s=1.0)
            except SwarmError:
                return ()
            self._known = tuple(one.platform for one in found.platforms)
        return self._known


def config_dir(settings: CliSettings) -> Path:
    """Configuration folder of the node to join: `--config`, `--lab`, SWARM_CONFIG, a running lab, /etc/swarm.

    Raises: NotFound naming the places searched.
    """
    from swarmctl.session import labs

    if settings.config_dir is not None:
        return settings.config_dir
    lab = labs.chosen(settings)
    if lab is not None:
        return lab.station.config_dir
    if (DEFAULT_DIR / "node.toml").is_file():
        return DEFAULT_DIR
    raise NotFound(
        f"node: no running lab, no {DEFAULT_DIR}/node.toml; expected one, --config DIR or {CONFIG_VARIABLE}"
        " (`swarmctl lab up formation --nodes 4 --detach` starts a lab)"
    )


def local_config_dirs(settings: CliSettings) -> dict[str, Path]:
    """Configuration folders of the selected platforms, whose files must be on this machine, in natural order.

    Without a selection it is the folder of the node to join. Raises: NotFound when one is on another machine.
    """
    from swarmctl.session import labs

    joined = config_dir(settings)
    # `--config` selects a node by itself, even if it is a lab's
    lab = labs.of_station(joined) if settings.config_dir is None else None
    if lab is None:
        known = {load_node(joined).platform: joined}
    else:
        known = {node.platform: node.config_dir for node in lab.nodes}
    if not settings.node:
        return {name: folder for name, folder in known.items() if folder == joined}
    try:
        chosen = NodeSelection(settings.node).choose(known, "this machine")
    except NotFound as error:
        raise NotFound(f"files of {error}; expected one of these, or swarmctl on its machine") from error
    return {name: known[name] for name in chosen}


@asynccontextmanager
async def connect(settings: CliSettings, out: Output | None = None) -> AsyncIterator[Session]:
    """Joins the node.

    Raises: NotFound without a node, NoAnswer when its services do not run, ConfigError, Denied.
    """
    folder = config_dir(settings)
    node = load_node(folder)
    _check_open(node.run_path)
    if not populated(node.run_path):
        raise NoAnswer(f"node {node.platform} ({folder}): its services do not run; expected them to")
    async with Client(NAME, config_dir=folder) as module:
        yield Session(module, settings, out or Output(settings))


def _check_open(run_dir: Path) -> None:
    """Check that this user may join the node. Raises: Denied."""
    if not run_dir.exists() or os.access(run_dir, os.R_OK | os.X_OK):
        return
    raise Denied(
        f"{run_dir}: closed to this user; expected root, or a member of its group (under systemd: group"
        " swarm): as root `swarmctl host install --operator NAME`, then a new login"
    )


def run(
    settings: CliSettings,
    command: Callable[Concatenate[Session, P], Awaitable[T]],
    *args: P.args,
    **kwargs: P.kwargs,
) -> T:
    """Joins the node, calls `command(session, …)`, and leaves the node."""

    async def main() -> T:
        async with connect(settings) as session:
            return await command(session, *args, **kwargs)

    return asyncio.run(main())
