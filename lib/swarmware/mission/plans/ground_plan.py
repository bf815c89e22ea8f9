"""Reader of `.plan`, the plans of QGroundControl."""

from enum import StrEnum
from typing import Any, Final

from swarmware.errors import MissionError
from swarmware.mission.plans.plan import Plan, PlanItem, PlannedHome, Unsupported
from swarmware.mission.source import JsonSource, SourceError, parse


class ItemType(StrEnum):
    """Value of `type` of an item."""

    SIMPLE = "SimpleItem"
    COMPLEX = "ComplexItem"
    """A survey or another pattern, which contains the items of its transects."""


_AREAS: Final = (("geoFence", "polygons"), ("geoFence", "circles"), ("rallyPoints", "points"))
_WINGS: Final = frozenset({1, *range(19, 26)})
"""MAV_TYPE of fixed wings and VTOLs, which circle where a multirotor holds."""
_FENCE_HINT: Final = "missions have none; set a fence in the configuration of the vehicle (nav/fence)"
_RALLY_HINT: Final = "missions have none; a vehicle returns to the place where it was armed"


def read_ground_plan(text: str, file: str) -> Plan:
    """Read a plan; a survey or corridor counts as the items of its transects.

    Raises: MissionError with file, line and item.
    """
    try:
        return _GroundPlanReader(parse(text, file)).plan()
    except SourceError as error:
        raise MissionError(str(error.finding)) from error


class _GroundPlanReader:
    def __init__(self, source: JsonSource) -> None:
        self._source = source
        self._unsupported: list[Unsupported] = []
        self._items: list[PlanItem] = []
        self._numbers: set[int] = set()

    def plan(self) -> Plan:
        top = self._source.value
        if not isinstance(top, dict) or top.get("fileType") != "Plan":
            raise self._refusal("", 'expected a plan of QGroundControl, {"fileType": "Plan", …}')
        mission = top.get("mission")
        if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
            raise self._refusal("/mission", 'expected {"items": […], …}')
        self._read_items(mission["items"], "/mission/items")
        self._areas(top)
        kind = self._number(mission.get("vehicleType"), "/mission/vehicleType")
        if kind in _WINGS:
            line = self._source.line("/mission/vehicleType")
            reason = "a fixed wing or VTOL; expected a plan of a multirotor, whose motions differ"
            self._unsupported.append(Unsupported(line, f"vehicle type {kind:g}", reason))
        home = self._home(mission.get("plannedHomePosition"))
        autopilot = self._number(mission.get("firmwareType", 0), "/mission/firmwareType")
        speed = self._number(mission.get("hoverSpeed"), "/mission/hoverSpeed")
        return Plan(
            self._source.file, tuple(self._items), home, int(autopilot or 0), speed, tuple(self._unsupported)
        )

    def _read_items(self, items: list[Any], pointer: str) -> None:
        for index, raw in enumerate(items):
            here = f"{pointer}/{index}"
            kind = raw.get("type") if isinstance(raw, dict) else None
            if kind == ItemType.SIMPLE:
                self._items.append(self._simple(raw, here))
            elif kind == ItemType.COMPLEX:
                self._complex(raw, here)
            else:
                raise self._refusal(here, f"item {index + 1}: {kind!r}: expected a simple or complex one")

    def _complex(self, raw: dict[str, Any], pointer: str) -> None:
        transects = raw.get("TransectStyleComplexItem")
        inner = transects.get("Items") if isinstance(transects, dict) else None
        if isinstance(inner, list):
            self._read_items(inner, f"{pointer}/TransectStyleComplexItem/Items")
            return
        kind = str(raw.get("complexItemType"))[:40]
        part = f"complex item {kind!r} (item {pointer.rpartition('/')[2]} of the list)"
        reason = "has no transects; expected a survey or corridor scan"
        self._unsupported.append(Unsupported(self._source.line(pointer), part, reason))

    def _simple(self, raw: dict[str, Any], pointer: str) -> PlanItem:
        values = raw.get("params")
        if not isinstance(values, list) or len(values) != 7:
            raise self._refusal(f"{pointer}/params", "expected a list of 7 values")
        numbers = [self._number(value, f"{pointer}/params/{n}") for n, value in enumerate(values)]
        number, command, frame = (
            self._whole(raw.get(key), f"{pointer}/{key}") for key in ("doJumpId", "command", "frame")
        )
        if number in self._numbers:
            raise self._refusal(pointer, f"item {number} occurs twice; expected each doJumpId once")
        self._numbers.add(number)
        line = self._source.line(pointer)
        return PlanItem(number, line, command, frame, tuple(numbers[:4]), *numbers[4:])

    def _areas(self, top: dict[str, Any]) -> None:
        for group, key in _AREAS:
            found = top.get(group)
            members = found.get(key, []) if isinstance(found, dict) else []
            if not isinstance(members, list):
                raise self._refusal(f"/{group}/{key}", "expected a list")
            if members:
                line = self._source.line(f"/{group}/{key}")
                hint = _FENCE_HINT if group == "geoFence" else _RALLY_HINT
                self._unsupported.append(Unsupported(line, f"{group} ({len(members)} {key})", hint))

    def _home(self, raw: Any) -> PlannedHome | None:
        pointer = "/mission/plannedHomePosition"
        if raw is None:
            return None
        if not isinstance(raw, list) or len(raw) != 3:
            raise self._refusal(pointer, "expected [latitude, longitude, height]")
        lat, lon, height = (self._number(value, pointer) for value in raw)
        return None if lat is None or lon is None else PlannedHome(lat, lon, height or 0.0)

    def _number(self, value: Any, pointer: str) -> float | None:
        """A number, or None for null, by which a plan leaves a value to the autopilot."""
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e12:
            raise self._refusal(pointer, f"{str(value)[:40]!r}: expected a number")
        return float(value)

    def _whole(self, value: Any, pointer: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 65_535:
            raise self._refusal(pointer, f"{str(value)[:40]!r}: expected a whole number from 0 to 65535")
        return value

    def _refusal(self, pointer: str, message: str) -> MissionError:
        return MissionError(str(self._source.finding(pointer, "plan", message)))
