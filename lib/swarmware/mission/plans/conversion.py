"""Conversion of a plan to a mission: one table from MAVLink commands to blocks."""

import json
import math
from collections.abc import Callable
from typing import Any, Final

import msgspec

from swarmware.errors import MissionError
from swarmware.mission.plans.flight_order import flight_order
from swarmware.mission.plans.plan import Plan, PlanItem, PlannedHome, Unsupported, unsupported

ToLocal = Callable[[float, float, float], tuple[float, float, float]]
"""Projection: latitude, longitude and height above the map's origin in; east, north and up in metres out."""

SPEED_M_S: Final = 1.5
"""Speed if the plan has none: the default of a Goto."""
SPEED_LIMIT_M_S: Final = 30.0
SPEED_MIN_M_S: Final = 0.1
"""Lowest speed, so that the time-out of a motion is finite."""
ORIGIN_TOLERANCE_DEG: Final = 0.00005
"""Distance of the map's origin from the converted one, 5.5 m of latitude: the error of a receiver."""
_AMSL: Final = frozenset({0, 5})
_RELATIVE: Final = frozenset({3, 6})
_FRAMES: Final = {1: "local", 2: "mission", 4: "local", 10: "terrain", 11: "terrain"}


class ConvertedPlan(msgspec.Struct, frozen=True):
    """A plan as a mission."""

    text: str
    """The mission in BDL."""
    blocks: int
    unsupported: tuple[Unsupported, ...]
    """Parts of the plan that the mission leaves out."""
    remarks: tuple[str, ...]
    """Additions to the plan of which an operator should know."""


def convert(plan: Plan, origin: PlannedHome, to_local: ToLocal) -> ConvertedPlan:
    """Convert a plan for a map with this origin, which has the height of the planned home.

    Raises: MissionError when nothing is left to fly.
    """
    order, jumps = flight_order(plan)
    route = _Route(plan, to_local)
    for item in order:
        if not route.add(item):
            break
    if not route.flies:
        reasons = "".join(f"\n{plan.file}:{part.line}: {part}" for part in route.unsupported)
        raise MissionError(f"{plan.file}: nothing to fly; expected at least one waypoint{reasons}")
    route.end()
    bounds = [("lat_deg", origin.lat_deg), ("lon_deg", origin.lon_deg)]
    mission = {
        "title": f"Plan {plan.file.rpartition('/')[2]}",
        "params": {"speed_m_s": route.speed_m_s},
        # another origin of the map would move the whole route
        "requires": [
            f"nav/origin.{field} {sign} {value + step:.7f}"
            for field, value in bounds
            for sign, step in ((">", -ORIGIN_TOLERANCE_DEG), ("<", ORIGIN_TOLERANCE_DEG))
        ],
        "mission": route.blocks,
    }
    text = json.dumps(mission, indent=1, ensure_ascii=False) + "\n"
    left_out = dict.fromkeys((*plan.unsupported, *jumps, *route.unsupported))
    return ConvertedPlan(text, len(route.blocks), tuple(left_out), tuple(route.remarks))


class _Refused(Exception):
    """An item cannot be kept; not raised outside of this file."""


class _Route:
    """Blocks so far, and the vehicle's state after them."""

    def __init__(self, plan: Plan, to_local: ToLocal) -> None:
        self._plan = plan
        self._to_local = to_local
        self.speed_m_s = plan.speed_m_s or SPEED_M_S
        if not SPEED_MIN_M_S <= self.speed_m_s <= SPEED_LIMIT_M_S:
            message = (
                f"planned speed {self.speed_m_s:g} m/s: expected {SPEED_MIN_M_S:g} to {SPEED_LIMIT_M_S:g}"
            )
            raise MissionError(f"{plan.file}: {message}")
        self._speed: float | str = "$param.speed_m_s"
        self._place: tuple[float, float, float | None] | None = None
        self._armed = False
        self._airborne = False
        self._item: PlanItem | None = None
        self.flies = False
        self.blocks: dict[str, dict[str, Any]] = {"start": {"type": "Start", "next": "end"}}
        self._last = "start"
        self.unsupported: list[Unsupported] = []
        self.remarks: list[str] = []

    def add(self, item: PlanItem) -> bool:
        """Add the blocks of an item; False if the plan ends with it."""
        self._item = item
        convert = _TABLE.get(item.command)
        try:
            if convert is None:
                raise _Refused("no block does this")
            return convert(self, item)
        except _Refused as refused:
            self.unsupported.append(unsupported(item, str(refused)))
            return True

    def end(self) -> None:
        """Add the end; a landed vehicle is disarmed."""
        self._item = None
        if self._armed and not self._airborne:
            self._block("Disarm")
        self.blocks["end"] = {"type": "End"}

    def _block(self, kind: str, **params: Any) -> None:
        name = f"b{len(self.blocks)}"
        self.blocks[self._last]["next"] = name
        self.blocks[name] = {"type": kind, **params, "next": "end"}
        if self._item is not None:
            self.blocks[name]["title"] = f"item {self._item.number}"
        self._last = name

    def _climb(self, height_m: float) -> None:
        if not 0 < height_m <= 1000:
            raise _Refused(f"take-off to {height_m:g} m above home: expected a height of up to 1000 m")
        if not self._armed:
            self._block("Arm")
        # the default time-out of 60 s is for 90 m
        self._block("Takeoff", altitude_m=height_m, timeout_s=math.ceil(60 + 2 * height_m))
        self._armed = self._airborne = self.flies = True
        if self._place:
            self._place = (*self._place[:2], height_m)

    def _height(self, item: PlanItem) -> float:
        """Height of the item above home."""
        height = item.height_m
        if height is None:
            raise _Refused("no height; expected a height in metres")
        if item.frame in _RELATIVE:
            return height
        if item.frame not in _AMSL:
            name = _FRAMES.get(item.frame, "unknown")
            raise _Refused(f"frame {item.frame} ({name}): expected a height above home or sea level (3, 0)")
        if self._plan.home is None:
            raise _Refused("a height above sea level in a plan without a home position")
        return height - self._plan.home.height_amsl_m

    def _move(self, item: PlanItem, yaw_deg: float | None = None) -> None:
        """Move to the item's position, and take off before if the plan does not."""
        height = self._height(item)
        # without a position of its own an item means the present position
        if item.lat_deg is None or item.lon_deg is None or not (item.lat_deg or item.lon_deg):
            raise _Refused("no position; expected a latitude and longitude")
        x_m, y_m, z_m = (round(value, 3) for value in self._to_local(item.lat_deg, item.lon_deg, height))
        if not self._airborne:
            self._climb(height)
            self.remarks.append(
                f"item {item.number}: no take-off before it; the mission climbs to {height:g} m"
            )
        self._goto((x_m, y_m, z_m), yaw_deg)

    def _goto(self, place: tuple[float, float, float | None], yaw_deg: float | None) -> None:
        params: dict[str, Any] = {"x_m": place[0], "y_m": place[1]}
        if place[2] is not None:
            params["z_m"] = place[2]
        if yaw_deg is not None:
            # compass to the angle from east to north
            params["yaw_rad"] = round(math.remainder(math.radians(90 - yaw_deg), math.tau), 4)
        start = self._place or (0.0, 0.0, 0.0)
        length = math.dist(start[:2], place[:2]) + abs((place[2] or 0.0) - (start[2] or 0.0))
        speed = self._speed if isinstance(self._speed, float) else self.speed_m_s
        # an operator may fly at a third of the speed before the time-out ends the mission
        self._block("Goto", **params, speed_m_s=self._speed, timeout_s=math.ceil(120 + 3 * length / speed))
        self._place = place

    def _pause(self, duration_s: float) -> None:
        if not 0 <= duration_s <= 86_400:
            raise _Refused(f"{duration_s:g} s: expected a time of 0 to 86400 s")
        if duration_s:
            self._block("Wait", s=duration_s)

    def _in_the_air(self) -> None:
        if not self._airborne:
            raise _Refused("before a take-off; expected a NAV_TAKEOFF first")

    def waypoint(self, item: PlanItem) -> bool:
        """Move, then wait for param 1."""
        if item.param(3):
            raise _Refused(f"param 3 {item.param(3):g}: a pass beside the waypoint; expected 0")
        yaw = item.params[3]
        # ArduPilot's tools write 0 for any heading, PX4's leave it out
        free = yaw is None or (yaw == 0 and self._plan.autopilot != 12)
        if not 0 <= item.param(1) <= 86_400:
            raise _Refused(f"hold of {item.param(1):g} s: expected a time of 0 to 86400 s")
        self._move(item, None if free else yaw)
        self._pause(item.param(1))
        return True

    def loiter_forever(self, item: PlanItem) -> bool:
        """Move and stay: the plan ends there, and the vehicle holds until the next order."""
        self._move(item)
        return False

    def loiter_time(self, item: PlanItem) -> bool:
        """Move and hold for param 1; a multirotor flies no circle."""
        if not 0 <= item.param(1) <= 86_400:
            raise _Refused(f"{item.param(1):g} s: expected a time of 0 to 86400 s")
        self._move(item)
        self._pause(item.param(1))
        return True

    def loiter_height(self, item: PlanItem) -> bool:
        """Move to the position and height."""
        self._move(item)
        return True

    def take_off(self, item: PlanItem) -> bool:
        """Climb straight up, as a multirotor of PX4 and ArduPilot does."""
        if item.params[3]:
            raise _Refused(f"heading {item.param(4):g}: expected a take-off with any heading")
        self._climb(self._height(item))
        return True

    def land(self, item: PlanItem) -> bool:
        """Move above the place at the present height, then land."""
        self._in_the_air()
        if item.param(2):
            raise _Refused(f"param 2 {item.param(2):g}: a precision landing; expected 0")
        if item.lat_deg and item.lon_deg:
            x_m, y_m, _ = self._to_local(item.lat_deg, item.lon_deg, 0.0)
            self._goto((round(x_m, 3), round(y_m, 3), None), None)
        self._block("Land", timeout_s=1200)
        self._airborne = False
        return True

    def return_home(self, item: PlanItem) -> bool:
        """Return and land; the plan ends with it."""
        self._in_the_air()
        self._block("Return", timeout_s=86_400)
        self._block("Land", timeout_s=1200)
        self._airborne = False
        return False

    def delay(self, item: PlanItem) -> bool:
        """Wait for param 1."""
        if item.param(1) < 0:
            raise _Refused("a time of the day; expected a delay in seconds")
        self._pause(item.param(1))
        return True

    def heading(self, item: PlanItem) -> bool:
        """Turn at the present position."""
        if item.param(4):
            raise _Refused("a relative angle; expected an absolute heading")
        self._in_the_air()
        if self._place is None:
            raise _Refused("before the first waypoint; expected it at a known position")
        self._goto(self._place, item.param(1))
        return True

    def speed(self, item: PlanItem) -> bool:
        """Change the speed of the following motions."""
        value = item.param(2)
        if item.param(1) not in {0, 1} or not SPEED_MIN_M_S <= value <= SPEED_LIMIT_M_S:
            message = (
                f"type {item.param(1):g}, {value:g} m/s: expected {SPEED_MIN_M_S:g} to {SPEED_LIMIT_M_S:g}"
            )
            raise _Refused(f"{message} m/s along the course (type 0 or 1)")
        self._speed = value
        return True

    def nothing(self, item: PlanItem) -> bool:
        """Only marks a place in the list."""
        return True


_TABLE: Final[dict[int, Callable[[_Route, PlanItem], bool]]] = {
    16: _Route.waypoint,
    17: _Route.loiter_forever,
    19: _Route.loiter_time,
    20: _Route.return_home,
    21: _Route.land,
    22: _Route.take_off,
    31: _Route.loiter_height,
    93: _Route.delay,
    115: _Route.heading,
    178: _Route.speed,
    189: _Route.nothing,
}
"""Blocks of each command; any other command is unsupported."""
