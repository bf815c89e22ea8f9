"""Settings as resources: one board each, its value from the store or the default."""

import asyncio
import logging
from collections.abc import Iterable

import msgspec

from swarmd.tree.core.value import typed
from swarmd.tree.store import Store
from swarmware.errors import InvalidInput, NotFound, SwarmError
from swarmware.module import BoardWriter, Module
from swarmware.resource import Kind, Plain, Resource
from swarmware.types import registry

log = logging.getLogger("swarm.tree")


class Settings:
    """The settings of this platform."""

    def __init__(self, module: Module, store: Store) -> None:
        self._module = module
        self._store = store
        self._boards: dict[str, BoardWriter[msgspec.Struct]] = {}

    async def publish(self, resources: Iterable[Resource]) -> None:
        """Makes the boards of settings that have none yet."""
        for resource in resources:
            if resource.kind is Kind.SETTING and resource.path not in self._boards:
                writer = await self._module.writer(
                    resource.path, registry.find(resource.type), resource=resource
                )
                self._boards[resource.path] = writer
                writer.write(self._value(resource))

    def _value(self, resource: Resource) -> msgspec.Struct:
        kept = self._store.get(resource.path)
        if kept is not None:
            try:
                return typed(resource, kept.value, resource.path)
            except SwarmError as error:
                log.warning("kept setting does not fit any more, the default holds: %s", error)
        return typed(resource, resource.default, resource.path)

    def version(self, local: str) -> int | None:
        """Count of changes of a setting; None when it is none."""
        if local not in self._boards:
            return None
        kept = self._store.get(local)
        return kept.version if kept is not None else 0

    async def set(self, resource: Resource, value: msgspec.Struct) -> int:
        """Keeps the value and publishes it; its version.

        Raises: SwarmError when it cannot be kept; nothing has changed then.
        """
        plain: Plain = value.value  # type: ignore[attr-defined]  # settings are single values
        before = _plain(self._value(resource))
        try:
            kept = await asyncio.to_thread(self._store.put, resource.path, plain, before)
        except OSError as error:
            raise SwarmError(f"{resource.path}: cannot be kept: {error}; the old value holds") from error
        self._boards[resource.path].write(value)
        return kept.version

    async def undo(self, resource: Resource, shown: str) -> tuple[msgspec.Struct, int]:
        """Back to the value before the last change; the value and its version.

        Raises: NotFound when it was never changed, InvalidInput when it is no setting.
        """
        if resource.kind is not Kind.SETTING:
            raise InvalidInput(f"{shown}: a {resource.kind} keeps no former value; expected a setting")
        kept = self._store.get(resource.path)
        if kept is None or kept.before is None:
            raise NotFound(f"{shown}: was not changed; nothing to undo")
        value = typed(resource, kept.before, shown)
        return value, await self.set(resource, value)


def _plain(value: msgspec.Struct) -> Plain:
    found: Plain = value.value  # type: ignore[attr-defined]  # settings are single values
    return found
