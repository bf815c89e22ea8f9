"""Requests for the configuration of this node, and for the history of its live settings."""

import asyncio
from typing import Any, Final

import msgspec

from swarmd.tree.settings.settings import Settings
from swarmware.model import paths
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.effective import NODE, effective_config, key_pattern
from swarmware.types.config import ConfigChange, ConfigHistory, ConfigQuery, EffectiveConfig, HistoryQuery

CHANGES_LIMIT: Final = 1000
"""Changes in a reply, which must fit into a frame."""


class ConfigApi:
    """Serves `sys/node/config` and `sys/tree/history`: the node answers for its own files and settings."""

    def __init__(self, module: Module, settings: Settings) -> None:
        self._module = module
        self._settings = settings
        self._reading = asyncio.Lock()

    def serve(self) -> None:
        """Registers the handlers of the requests."""
        self._module.serve("sys/node/config", ConfigQuery, self._config, reply=EffectiveConfig)
        self._module.serve("sys/tree/history", HistoryQuery, self._history, reply=ConfigHistory)

    async def _config(self, query: ConfigQuery, _: Meta) -> EffectiveConfig:
        node = self._module.node
        running: dict[str, dict[str, Any]] = {NODE: msgspec.to_builtins(node.config)}
        running |= {entry.name: entry.config for entry in node.applications.table if entry.instance == 1}
        async with self._reading:  # files and classes are read in a thread: one question at a time
            return await asyncio.to_thread(
                effective_config,
                node.config_dir,
                running,
                self._settings.live_values(),
                query.pattern,
                meanings=query.meanings,
                node=node.config,
            )

    def _history(self, query: HistoryQuery, _: Meta) -> ConfigHistory:
        wanted = key_pattern(query.pattern)
        prefix = paths.setting("")
        pack = msgspec.msgpack.encode
        found = self._settings.changes(lambda path: wanted(path.removeprefix(prefix)))
        return ConfigHistory(
            self._module.platform,
            tuple(
                ConfigChange(
                    path.removeprefix(prefix),
                    one.utc_ns,
                    one.by,
                    pack(one.before),
                    pack(one.after),
                    one.overrode,
                    one.overrides,
                )
                for path, one in found[:CHANGES_LIMIT]
            ),
        )
