"""The way into the swarm: finds a node of this machine and joins it as a module named swarmctl."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from swarmctl.output import Output
from swarmctl.settings import Settings
from swarmware import names
from swarmware.appfile import AppTable
from swarmware.config import DEFAULT_DIR, load_node
from swarmware.errors import NoAnswer, NotFound
from swarmware.module import Module

R = TypeVar("R", bound=msgspec.Struct)
T = TypeVar("T")

NAME: Final = "swarmctl"


class Link:
    """An operator's connection: the node that was joined, the platform that is asked about, the output."""

    def __init__(self, module: Module, settings: Settings, out: Output) -> None:
        self.module = module
        self.settings = settings
        self.out = out
        self.here = module.platform
        """Platform of the node that was joined."""
        self.platform = names.check_platform(settings.node) if settings.node else self.here
        """Platform that `--node` names, else the one that was joined."""

    def path(self, path: str) -> str:
        """A path as it was typed, with its platform: `nav/pose` → `/uav1/nav/pose` with `-n uav1`."""
        platform, local = names.split(path)
        return names.join(platform or self.platform, local)

    async def ask(
        self, path: str, value: msgspec.Struct, reply: type[R], *, timeout_s: float | None = None
    ) -> R:
        """Asks the platform that is meant, or the one that the path names.

        Raises: as `Module.request`.
        """
        wait_s = self.settings.timeout_s if timeout_s is None else timeout_s
        return await self.module.request(self.path(path), value, reply, timeout_s=wait_s)


def config_dir(settings: Settings) -> Path:
    """Configuration folder of the node to join: `--config`, else a running lab's station, else /etc/swarm.

    Raises: NotFound saying where was looked.
    """
    from swarmctl.lab import record

    if settings.config_dir is not None:
        return settings.config_dir
    if settings.lab:
        return record.find(settings.lab).station.config_dir
    running = [lab for lab in record.labs() if lab.running]
    if running:
        return running[-1].station.config_dir
    if (DEFAULT_DIR / "node.toml").is_file():
        return DEFAULT_DIR
    raise NotFound(
        f"node: no running lab, no {DEFAULT_DIR}/node.toml; expected one, or --config DIR"
        " (`swarmctl lab up formation --nodes 4 --detach` starts a lab)"
    )


@asynccontextmanager
async def connect(settings: Settings, out: Output | None = None) -> AsyncIterator[Link]:
    """Joins the node.

    Raises: NotFound without a node, NoAnswer when nothing runs on it, ConfigError, Denied.
    """
    folder = config_dir(settings)
    node = load_node(folder)
    table = AppTable(node.run_path)
    table.refresh(probe=True)
    if not len(table):
        raise NoAnswer(f"node {node.platform} ({folder}): nothing runs there; expected its services")
    async with Module(NAME, config_dir=folder) as module:
        yield Link(module, settings, out or Output(settings))


def run(settings: Settings, command: Callable[[Link], Awaitable[T]]) -> T:
    """Joins the node, runs the command on it, leaves again: what most commands are made of."""

    async def main() -> T:
        async with connect(settings) as link:
            return await command(link)

    return asyncio.run(main())
