"""Settings as resources: one board each, with the stored value, else the file's value, else the default."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from typing import Any, Final

import msgspec

from swarmd.tree.core.values.value import typed
from swarmd.tree.settings.store import SettingsStore
from swarmware.errors import Conflict, InvalidInput, NotFound, SwarmError
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.model.resource import Kind, Plain, Resource
from swarmware.model.stored_setting import LiveValue, SettingChange
from swarmware.module.module import Module
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS, BoardWriter
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types import registry
from swarmware.types.tree import TreeSetDone

log = logging.getLogger("swarm.tree")

NEVER_SET: Final = 0
"""Version of a setting that was never changed."""
APPLY_S: Final = 1.5
"""Time that an application has: `mission` looks once a second; the answer must come before `answer_s`."""


class Settings:
    """Publishes, changes and restores the settings of this platform."""

    def __init__(self, module: Module, store: SettingsStore) -> None:
        self._module = module
        self._store = store
        self._boards: dict[str, BoardWriter[msgspec.Struct]] = {}
        self._refused: dict[str, Resource] = {}
        self._files: dict[str, Plain] = {}
        """Values of the files that the owners have read, by path."""
        self._joined: dict[str, int] = {}
        """Instant at which each application with settings has joined."""
        self._writing = asyncio.Lock()

    def publish(self, resources: Iterable[Resource]) -> None:
        """Open a board for each setting of the tree, and close the boards of removed settings."""
        wanted = {resource.path: resource for resource in resources if resource.kind is Kind.SETTING}
        for path in [path for path, board in self._boards.items() if board.resource != wanted.get(path)]:
            self._boards.pop(path).close(unlink=path not in wanted)
        for path, resource in wanted.items():
            # a refused setting is tried again when its resource changes, not at each other change
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

    def on_applications(self, table: Iterable[AppEntry]) -> None:
        """Take the values of files from applications that have joined, and write their settings again.

        An application takes only what was written after it has joined: its file may have changed before.
        """
        for entry in table:
            # a restarted application has another start; a changed file alone is not a restart
            if not entry.live or self._joined.get(entry.id) == entry.started_ns:
                continue
            self._joined[entry.id] = entry.started_ns
            for key, name in entry.live.items():
                path = paths.setting(name)
                if (value := _configured(entry.config, key)) is not None:
                    self._files[path] = value
                if board := self._boards.get(path):
                    board.write(self._value(board.resource))

    def _value(self, resource: Resource) -> msgspec.Struct:
        kept = self._store.get(resource.path)
        if kept is not None and kept.value is not None:
            try:
                return typed(resource, kept.value, resource.path)
            except SwarmError as error:
                log.warning("stored setting is invalid, the file or the default applies: %s", error)
        return self._own_value(resource)

    def _own_value(self, resource: Resource) -> msgspec.Struct:
        """The value without an override: the value of the owner's file, else the default."""
        if (value := self._files.get(resource.path)) is not None:
            # the owner has checked it by its own limits, and it is in force there
            free = msgspec.structs.replace(resource, range=None, choices=())
            try:
                return typed(free, value, resource.path)
            except SwarmError as error:
                log.warning("setting %s: value of its file: %s", resource.path, error)
        return typed(resource, resource.default, resource.path)

    def live_values(self) -> dict[str, LiveValue]:
        """The settings in force, by path."""
        return {
            path: LiveValue(board.resource, _plain(self._value(board.resource)), self._store.get(path))
            for path, board in self._boards.items()
        }

    def changes(self, matches: Callable[[str], bool]) -> list[tuple[str, SettingChange]]:
        """The stored changes of the settings whose path matches, the newest first."""
        found = [(path, one) for path, kept in self._store if matches(path) for one in kept.history]
        return sorted(found, key=lambda item: item[1].utc_ns, reverse=True)

    def version(self, local: str) -> int | None:
        """Number of changes of a setting, or None for another resource."""
        if local not in self._boards:
            return None
        kept = self._store.get(local)
        return kept.version if kept is not None else NEVER_SET

    async def set(
        self, resource: Resource, value: msgspec.Struct, shown: str, by: str, expected: int | None = None
    ) -> int:
        """Store and publish a value; returns its version. `expected`: version before the change.

        Raises: Conflict if it has another version, SwarmError if it cannot be stored; nothing has
        changed then.
        """
        return await self._change(resource, value, shown, by, expected)

    async def reset(self, resource: Resource, shown: str, by: str) -> tuple[msgspec.Struct, int]:
        """Remove the override; returns the value of the file, else the default, and its version.

        Raises: InvalidInput if it is not a setting; as `set`.
        """
        if resource.kind is not Kind.SETTING:
            raise InvalidInput(f"{shown}: a {resource.kind} has no default; expected a setting")
        value = self._own_value(resource)
        kept = self._store.get(resource.path)
        # no override to remove: the version must not change without an effect
        if kept is None or kept.value is None:
            return value, NEVER_SET if kept is None else kept.version
        return value, await self._change(resource, value, shown, by, kept.version, overrides=False)

    async def undo(self, resource: Resource, shown: str, by: str) -> tuple[msgspec.Struct, int]:
        """Restore the value before the last change; returns the value and its version.

        Raises: NotFound if it was never changed, InvalidInput if it is not a setting; as `set`.
        """
        if resource.kind is not Kind.SETTING:
            raise InvalidInput(f"{shown}: a {resource.kind} keeps no former value; expected a setting")
        kept = self._store.get(resource.path)
        last = kept.history[-1] if kept is not None and kept.history else None
        before = last.before if last is not None else kept.before if kept is not None else None
        if kept is None or before is None:
            raise NotFound(f"{shown}: was not changed; nothing to undo")
        overrides = last is None or last.overrode
        value = typed(resource, before, shown) if overrides else self._own_value(resource)
        return value, await self._change(resource, value, shown, by, kept.version, overrides=overrides)

    async def _change(
        self,
        resource: Resource,
        value: msgspec.Struct,
        shown: str,
        by: str,
        expected: int | None,
        *,
        overrides: bool = True,
    ) -> int:
        async with self._writing:
            board = self._boards.get(resource.path)
            if board is None or board.resource != resource:
                raise NotFound(f"{shown}: is not in force; the log of {self._module.platform} has the reason")
            # inside the lock: two operators with the same version must not both succeed
            present = self.version(resource.path)
            if expected is not None and expected != present:
                found = msgspec.json.encode(_plain(self._value(resource))).decode()
                raise Conflict(f"{shown}: has version {present} ({found}) now; expected {expected}")
            kept = self._store.get(resource.path)
            change = SettingChange(
                utc_ns=utc_ns(),
                by=by,
                before=_plain(self._value(resource)),
                after=_plain(value),
                overrode=kept is not None and kept.value is not None,
                overrides=overrides,
            )
            try:
                # the disk before the board: a value in force must survive a restart
                stored = await asyncio.to_thread(self._store.put, resource.path, change)
            except OSError as error:
                raise SwarmError(f"{shown}: cannot be stored: {error}; the old value stays") from error
            board.write(value)
            return stored.version

    def close(self) -> None:
        """Stop writing; the values stay readable until the node ends."""
        for board in self._boards.values():
            board.close(unlink=False)
        self._boards.clear()


class SettingEffect:
    """Follows a changed setting until each application that has it states the value in its file."""

    def __init__(self, module: Module, apply_s: float = APPLY_S) -> None:
        self._module = module
        self._apply_s = apply_s

    async def followed(self, path: str, value: msgspec.Struct, done: TreeSetDone) -> TreeSetDone:
        """The answer, with the applications that have taken the value, and those that have not in time."""
        plain = _plain(value)
        changed = asyncio.Event()
        # before the first look: a change between look and subscription would be missed
        subscription = self._module.node.applications.subscribe(lambda _: changed.set())
        try:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._apply_s):
                    while self._having(path, plain, applied=False):
                        await changed.wait()
                        changed.clear()
        finally:
            subscription.close()
        return msgspec.structs.replace(
            done,
            applied_by=self._having(path, plain, applied=True),
            awaited=self._having(path, plain, applied=False),
        )

    def _having(self, path: str, value: Plain, *, applied: bool) -> tuple[str, ...]:
        """Applications with the setting; `applied`: those that state the value, else the others."""
        return tuple(
            entry.name
            for entry in self._module.node.applications.table
            for name in entry.live.values()
            if paths.setting(name) == path and (entry.applied.get(name) == value) is applied
        )


def _plain(value: msgspec.Struct) -> Plain:
    plain: Plain = msgspec.msgpack.decode(registry.encode(value))[0]
    return plain


def _configured(config: dict[str, Any], key: str) -> Plain | None:
    """The plain value of a dotted key, or None without one."""
    found: Any = config
    for part in key.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    return found if isinstance(found, bool | int | float | str) else None
