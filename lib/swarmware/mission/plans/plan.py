"""A plan of another tool as typed items, independent of its file format."""

from typing import Final

import msgspec

ARDUPILOT: Final = 3
"""MAV_AUTOPILOT_ARDUPILOTMEGA, the autopilot for which the waypoints format was made."""

COMMANDS: Final = {
    16: "NAV_WAYPOINT",
    17: "NAV_LOITER_UNLIM",
    18: "NAV_LOITER_TURNS",
    19: "NAV_LOITER_TIME",
    20: "NAV_RETURN_TO_LAUNCH",
    21: "NAV_LAND",
    22: "NAV_TAKEOFF",
    31: "NAV_LOITER_TO_ALT",
    82: "NAV_SPLINE_WAYPOINT",
    84: "NAV_VTOL_TAKEOFF",
    85: "NAV_VTOL_LAND",
    93: "NAV_DELAY",
    112: "CONDITION_DELAY",
    115: "CONDITION_YAW",
    177: "DO_JUMP",
    178: "DO_CHANGE_SPEED",
    183: "DO_SET_SERVO",
    189: "DO_LAND_START",
    201: "DO_SET_ROI",
    205: "DO_MOUNT_CONTROL",
    206: "DO_SET_CAM_TRIGG_DIST",
    530: "SET_CAMERA_MODE",
    2000: "IMAGE_START_CAPTURE",
    2001: "IMAGE_STOP_CAPTURE",
    2500: "VIDEO_START_CAPTURE",
    2501: "VIDEO_STOP_CAPTURE",
    3000: "DO_VTOL_TRANSITION",
}
"""Names of MAV_CMD for messages.

Source: MAVLink, common.xml.
"""


class PlanItem(msgspec.Struct, frozen=True):
    """One item of a plan, a MAVLink mission item."""

    number: int
    """Number in the file, to which DO_JUMP refers."""
    line: int
    command: int
    """MAV_CMD."""
    frame: int
    """MAV_FRAME of the coordinates."""
    params: tuple[float | None, ...]
    """Params 1 to 4, each a number, or None if the file leaves the value to the autopilot."""
    lat_deg: float | None
    """Param 5, a latitude in items with a position."""
    lon_deg: float | None
    height_m: float | None
    """Param 7, a height in items with a position."""

    def param(self, number: int) -> float:
        """Param 1 to 4, or 0 if it is not given."""
        return self.params[number - 1] or 0.0


class Unsupported(msgspec.Struct, frozen=True):
    """A part of a plan that a mission cannot keep."""

    line: int
    part: str
    """Name of the part: `item 3 (command 82, NAV_SPLINE_WAYPOINT)`, or `geofence`."""
    reason: str

    def __str__(self) -> str:
        return f"{self.part}: {self.reason}"


class PlannedHome(msgspec.Struct, frozen=True):
    """Planned place of the start, to which relative heights refer."""

    lat_deg: float
    lon_deg: float
    height_amsl_m: float


class Plan(msgspec.Struct, frozen=True):
    """The content of a file."""

    file: str
    items: tuple[PlanItem, ...]
    home: PlannedHome | None
    autopilot: int = ARDUPILOT
    """MAV_AUTOPILOT for which the plan was made."""
    speed_m_s: float | None = None
    """Planned speed, or None if the file has none."""
    unsupported: tuple[Unsupported, ...] = ()
    """Parts other than items, such as a geofence."""


def unsupported(item: PlanItem, reason: str) -> Unsupported:
    """The refusal of one item."""
    name = COMMANDS.get(item.command, "unknown")
    return Unsupported(item.line, f"item {item.number} (command {item.command}, {name})", reason)
