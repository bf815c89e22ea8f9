"""Present values of resources, for the conditions of a mission."""

from collections.abc import Iterable
from typing import Any, Final

import msgspec

from swarmware.errors import NotFound
from swarmware.mission.field_path import Scalar, scalar_of
from swarmware.model.names import has_unit_branch, split
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types import registry

WELL_KNOWN: Final = {
    "power/battery": "BatteryState",
    "nav/pose": "Pose",
    "nav/status": "NavStatus",
    "nav/fence": "FenceState",
    "vehicle/state": "VehicleState",
    "health/state": "HealthState",
    "mission/state": "MissionState",
    "mission/watch": "MissionWatch",
    "vehicle/way_home": "WayHome",
    "system/load": "SystemLoad",
    "sensor/gnss": "GnssFix",
    "sensor/imu": "Imu",
}
"""Types of resources that every platform has, known before their owners run."""


class Values:
    """Opens a reader for each resource that a condition uses."""

    def __init__(self, module: Module) -> None:
        self._module = module
        self._readers: dict[str, BoardReader[Any]] = {}
        # before the first order: a value of another computer of this platform arrives after its subscription
        self.open(path for path in WELL_KNOWN if not has_unit_branch(path))

    def open(self, paths: Iterable[str]) -> None:
        """Opens readers for these resources; one of unknown type has no value."""
        for path in paths:
            if path not in self._readers and (cls := self._type(path)) is not None:
                self._readers[path] = self._module.reader(path, cls)

    def value(self, path: str, field: str) -> Scalar | None:
        """Newest value of the resource's field (empty: its only one)."""
        reader = self._readers.get(path)
        return None if reader is None else scalar_of(reader.value, field)

    def age_s(self, path: str) -> float | None:
        """Age of the newest value."""
        reader = self._readers.get(path)
        return None if reader is None else reader.age_s

    def _type(self, path: str) -> type[msgspec.Struct] | None:
        local = split(path)[1]
        name = WELL_KNOWN.get(local) or self._provided(local)
        try:
            return registry.find(name) if name else None
        except NotFound:
            return None  # a type of a package that is not installed on this node

    def _provided(self, local: str) -> str:
        table = self._module.node.table
        table.refresh()
        return next((r.type for entry in table for r in entry.provides if r.path == local and r.type), "")
