"""Reader of `QGC WPL 110`, the waypoints files of Mission Planner, MAVProxy and QGroundControl."""

import math
from typing import Final

from swarmware.errors import MissionError
from swarmware.mission.plans.plan import Plan, PlanItem, PlannedHome

HEADER: Final = "QGC WPL"
_VERSION: Final = "110"
_COLUMNS: Final = 12
_GREATEST: Final = 1e12
"""Greatest value of a column, so that no distance overflows."""
_INT_FRAMES: Final = frozenset({5, 6, 11})
"""Frames whose coordinates may be degrees times 10⁷ (MAV_FRAME_GLOBAL_INT and its variants)."""


def read_waypoints(text: str, file: str) -> Plan:
    """Read the rows; lines may end with CRLF, columns are separated by tabs or blanks.

    Row 0 is the home position if it is a waypoint in frame 0, as ArduPilot's tools write it.
    Raises: MissionError with file, line and row.
    """
    # only line feeds separate rows: splitlines would count more lines than an editor shows
    lines = text.split("\n")
    if lines[0].split() != [*HEADER.split(), _VERSION]:
        raise MissionError(f"{file}:1: {lines[0][:40]!r}: expected {HEADER} {_VERSION}")
    rows = [(line, row.split()) for line, row in enumerate(lines[1:], 2) if row.strip()]
    items = [_item(row, line, file) for line, row in rows]
    for number, item in enumerate(items):
        if item.number != number:
            raise MissionError(f"{file}:{item.line}: item {item.number}: expected number {number}")
    home = None
    if items and items[0].command == 16 and items[0].frame == 0:
        first = items.pop(0)
        # a home that no vehicle has reported yet is written as zeros
        if first.lat_deg or first.lon_deg:
            home = PlannedHome(first.lat_deg or 0.0, first.lon_deg or 0.0, first.height_m or 0.0)
    return Plan(file, tuple(items), home)


def _item(row: list[str], line: int, file: str) -> PlanItem:
    if len(row) != _COLUMNS:
        raise MissionError(f"{file}:{line}: {len(row)} columns; expected {_COLUMNS}")
    number = _whole(row[0], "number", line, file)
    frame = _whole(row[2], "frame", line, file)
    command = _whole(row[3], "command", line, file)
    values = [_value(word, column, line, file) for column, word in enumerate(row[4:11], 5)]
    lat, lon, height = values[4:]
    # a degree is never above 180, so only raw integers are scaled
    if frame in _INT_FRAMES and (abs(lat or 0.0) > 90 or abs(lon or 0.0) > 180):
        lat, lon = (lat or 0.0) / 1e7, (lon or 0.0) / 1e7
    return PlanItem(number, line, command, frame, tuple(values[:4]), lat, lon, height)


def _whole(word: str, what: str, line: int, file: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) <= 5):
        raise MissionError(f"{file}:{line}: {what} {word[:40]!r}: expected a whole number")
    return int(word)


def _value(word: str, column: int, line: int, file: str) -> float | None:
    """A value, or None for NaN, by which a tool leaves it to the autopilot."""
    try:
        value = float(word)
    except ValueError:
        value = math.inf
    if abs(value) > _GREATEST:
        raise MissionError(f"{file}:{line}: column {column}: {word[:40]!r}: expected a number") from None
    return None if math.isnan(value) else value
