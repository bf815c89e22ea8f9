"""Settings as resources: one board each, with the stored value or the default."""

import asyncio
import logging
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmd.tree.core.value import typed
from swarmd.tree.store import SettingsStore
from swarmware.errors import Conflict, InvalidInput, NotFound, SwarmError
from swarmware.model.resource import Kind, Plain, Resource
from swarmware.module.module import Module
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS, BoardWriter
from swarmware.types import registry

log = logging.getLogger("swarm.tree")

NEVER_SET: Final = 0
"""Version of a setting with its default value."""


class Settings:
    """Publishes, changes and restores the settings of this platform."""

    def __init__(self, module: Module, store: SettingsStore) -> None:
        self._module = module
        self._store = store
        self._boards: dict[str, BoardWriter[msgspec.Struct]] = {}
        self._refused: dict[str, Resource] = {}
        self._writing = asyncio.Lock()

    def publish(self, resources: Iterable[Resource]) -> None:
        """Open a board for each setting of the tree, and close those of removed settings."""
        wanted = {resource.path: resource for resource in resources if resource.kind is Kind.SETTING}
        for path in [path for path, board in self._boards.items() if board.resource != wanted.get(path)]:
            self._boards.pop(path).close(unlink=path not in wanted)
        for path, resource in wanted.items():
            if path not in self._boards and self._refused.get(path) != resource:
                self._publish(resource)

    def _publish(self, resource: Resource) -> None:
        node = self._module.node
        try:
            value = self._value(resource)
            publication = node.publication(resource.path, slots=BOARD_SLOTS, slot_bytes=BOARD_SLOT_BYTES)
        except SwarmError as error:
            self._refused[resource.path] = resource
            log.warning("setting %s: cannot be published: %s", resource.path, error)
            return
        self._refused.pop(resource.path, None)
        # not by Module.writer: the tree keeps settings for their owners, it does not provide them
        board = self._boards[resource.path] = BoardWriter(
            node, self._module.app_id, resource, type(value), publication
        )
        board.write(value)

    def _value(self, resource: Resource) -> msgspec.Struct:
        kept = self._store.get(resource.path)
        if kept is not None:
            try:
                return typed(resource, kept.value, resource.path)
            except SwarmError as error:
                log.warning("stored setting is invalid, the default applies: %s", error)
        return typed(resource, resource.default, resource.path)

    def version(self, local: str) -> int | None:
        """Number of changes of a setting; None for another resource."""
        if local not in self._boards:
            return None
        kept = self._store.get(local)
        return kept.version if kept is not None else NEVER_SET

    async def set(
        self, resource: Resource, value: msgspec.Struct, shown: str, expected: int | None = None
    ) -> int:
        """Store and publish a value; returns its version. `expected`: version before the change.

        Raises: Conflict if it has another version, SwarmError if it cannot be stored; nothing has
        changed then.
        """
        async with self._writing:
            board = self._boards.get(resource.path)
            if board is None or board.resource != resource:
                raise NotFound(f"{shown}: is not in force; the log of {self._module.platform} has the reason")
            present = self.version(resource.path)
            if expected is not None and expected != present:
                raise Conflict(f"{shown}: has version {present} now; expected {expected}")
            before = registry.encode(self._value(resource))
            former: Plain = msgspec.msgpack.decode(before)[0]
            plain: Plain = msgspec.msgpack.decode(registry.encode(value))[0]
            try:
                kept = await asyncio.to_thread(self._store.put, resource.path, plain, former)
            except OSError as error:
                raise SwarmError(f"{shown}: cannot be stored: {error}; the old value stays") from error
            board.write(value)
            return kept.version

    async def undo(self, resource: Resource, shown: str) -> tuple[msgspec.Struct, int]:
        """Restore the value before the last change; returns the value and its version.

        Raises: NotFound if it was never changed, InvalidInput if it is not a setting; as `set`.
        """
        if resource.kind is not Kind.SETTING:
            raise InvalidInput(f"{shown}: a {resource.kind} keeps no former value; expected a setting")
        kept = self._store.get(resource.path)
        if kept is None or kept.before is None:
            raise NotFound(f"{shown}: was not changed; nothing to undo")
        value = typed(resource, kept.before, shown)
        return value, await self.set(resource, value, shown, kept.version)

    def close(self) -> None:
        """Stop writing; the values stay readable until the node ends."""
        for board in self._boards.values():
            board.close(unlink=False)
        self._boards.clear()
