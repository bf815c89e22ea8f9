"""Whether the applications of this node have taken a setting that was changed (S1.75)."""

import asyncio
import contextlib
from typing import Final

import msgspec

from swarmware.model import paths
from swarmware.model.resource import Plain
from swarmware.module.module import Module
from swarmware.types import registry
from swarmware.types.tree import TreeSetDone

APPLY_S: Final = 1.5
"""Time that an application has: `mission` looks once a second; the answer must come before `answer_s`."""


class SettingEffect:
    """Follows a changed setting until each application that has it states the value in its file."""

    def __init__(self, module: Module, apply_s: float = APPLY_S) -> None:
        self._module = module
        self._apply_s = apply_s

    async def followed(self, path: str, value: msgspec.Struct, done: TreeSetDone) -> TreeSetDone:
        """The answer, with the applications that have taken the value, and those that have not in time."""
        plain: Plain = msgspec.msgpack.decode(registry.encode(value))[0]
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
