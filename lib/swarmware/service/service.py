"""A service: a daemon of this package, or a module of a user."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import msgspec

from swarmware.health.monitor import HealthMonitor
from swarmware.module.module import Module
from swarmware.runtime.core import Action, Core
from swarmware.runtime.driver import Boundary, CoreDriver


class NoSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a service without settings."""


class Service(ABC):
    """One class with `run()`, registered in the entry-point group `swarmware.services`.

    `run` may raise: the service is then restarted, without effect on others in the process.
    """

    name: ClassVar[str]
    """Name of the application, of the configuration file and of the entry point: [a-z][a-z0-9_-]{0,30}."""
    Config: ClassVar[type[msgspec.Struct]] = NoSettings
    """Settings, read from services/<name>.toml, or the file of `settings_of`."""
    settings_of: ClassVar[str] = ""
    """Service whose file also has this service's settings, or "" for an own file."""
    live_settings: ClassVar[Mapping[str, str]] = {}
    """Keys of the file, such as `altitude.kp_1_s`, and the keys of the live settings that override them.

    `config` has the overrides in force at the start, a LiveConfig those that come later.
    """
    stop_s: ClassVar[float] = 2.0
    """Time that `stop` may take."""

    def __init__(self, module: Module, config: Any) -> None:
        self.module = module
        self.config = config
        self.health = HealthMonitor(module)
        """Registers checks and reports conditions: `self.health.report(…)`."""

    def drive(
        self,
        core: Core[Action],
        perform: Callable[[Action], None],
        *,
        settled: Callable[[], None] | None = None,
        boundary: Boundary | None = None,
    ) -> CoreDriver[Action]:
        """Make the driver of a core of this service; `run` it, or feed it and stop it. See CoreDriver."""
        return CoreDriver(
            core,
            perform,
            name=self.name,
            clock=self.module.clock,
            loop=asyncio.get_running_loop(),
            settled=settled,
            boundary=boundary,
        )

    @abstractmethod
    async def run(self) -> None:
        """Run until cancelled; returning is a failure."""

    async def stop(self) -> None:  # noqa: B027  # most services have nothing to finish
        """Called before `run` is cancelled, to drain, save, and leave connections."""
