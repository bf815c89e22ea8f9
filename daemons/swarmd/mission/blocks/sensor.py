"""WaitForSensor: waits until a sensor of this platform delivers values (S4.12)."""

import asyncio
import contextlib
import math
from collections.abc import Iterable
from typing import Any, Final

from swarmd.mission.blocks.context import Context, spec
from swarmware.errors import SwarmError
from swarmware.mission.sensor_choice import SensorChoice, sought
from swarmware.model.names import split
from swarmware.model.resource import Kind, Resource
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.node.applications import ApplicationEvent
from swarmware.types import registry
from swarmware.types.tree import TreeList, TreeListing

FRESH_S: Final = 2.0
"""Age up to which a value counts as fresh where its resource has no period and no limit."""
LISTING_S: Final = 1.0
"""Period of the question for sensors of the platform's other computers: no event announces them."""


class WaitForSensorBlock:
    """Waits for a sensor that is given by its path, or by what it measures."""

    spec = spec("WaitForSensor")

    async def run(self, context: Context) -> None:
        """Ends when one of the sensors has a fresh value that meets the condition."""
        wanted = sought(context.params)
        assert wanted is not None
        choice = SensorChoice(wanted)
        context.report(0.0, f"waits for {choice}")
        path = await SensorSearch(context.module, choice).first()
        context.report(1.0, f"{path} is there")


class WaitForResourceBlock(WaitForSensorBlock):
    """Waits for a board of this platform, also of a module that starts meanwhile."""

    spec = spec("WaitForResource")


class SensorSearch:
    """Watches the sensors that are there, and those that appear meanwhile."""

    def __init__(self, module: Module, choice: SensorChoice) -> None:
        self._module = module
        self._choice = choice
        self._readers: dict[str, tuple[BoardReader[Any], float]] = {}
        """Reader of each sensor, and the age up to which its value is fresh."""
        self._wakeup = Wakeup()

    async def first(self) -> str:
        """Path of the first sensor with a value that suffices; waits for it."""
        node = self._module.node
        changes = node.applications.subscribe(self._on_applications)
        node.watch(self)
        listing = asyncio.create_task(self._list(), name="sensors of the platform")
        try:
            self._add(resource for entry in node.table for resource in entry.provides)
            while (found := self._sufficient()) is None:
                await self._wakeup.wait(None)
            return found
        finally:
            listing.cancel()
            await asyncio.wait([listing])
            node.unwatch(self)
            changes.close()
            for reader, _fresh_s in self._readers.values():
                self._module.close_reader(reader)

    def poll(self) -> None:
        """The doorbell has rung: a value was written."""
        self._wakeup.notify()

    def _on_applications(self, events: list[ApplicationEvent]) -> None:
        self._add(resource for event in events for resource in event.entry.provides)
        self._wakeup.notify()

    async def _list(self) -> None:
        """Takes what the tree knows of all computers of the platform."""
        async for _ in self._module.every(LISTING_S):
            with contextlib.suppress(SwarmError):  # the tree is not there, or knows none
                request = TreeList(self._choice.pattern)
                found = await self._module.request("sys/tree/list", request, TreeListing)
                for entry in found.entries:
                    self._add_one(split(entry.path)[1], entry.kind, entry.type, FRESH_S)
                self._wakeup.notify()

    def _add(self, resources: Iterable[Resource]) -> None:
        for one in resources:
            fresh_s = one.stale_after_s if math.isfinite(one.stale_after_s) else FRESH_S
            self._add_one(one.path, one.kind, one.type, fresh_s)

    def _add_one(self, path: str, kind: Kind, type_name: str, fresh_s: float) -> None:
        if path in self._readers or kind is not Kind.BOARD or not registry.installed(type_name):
            return
        cls = registry.find(type_name)
        if self._choice.means(path, cls):
            reader = self._module.reader(path, cls)
            reader.ring_only()
            self._readers[path] = (reader, fresh_s)

    def _sufficient(self) -> str | None:
        for path, (reader, fresh_s) in self._readers.items():
            value, age_s = reader.value, reader.age_s
            if value is not None and age_s is not None and self._choice.suffices(value, age_s, fresh_s):
                return path
        return None
