"""Reading of a plan: bytes of any known format in, items out."""

import codecs
from typing import Final

from swarmware.errors import MissionError
from swarmware.mission.plans.ground_plan import read_ground_plan
from swarmware.mission.plans.plan import Plan
from swarmware.mission.plans.waypoints import HEADER, read_waypoints
from swarmware.mission.source import SIZE_LIMIT

_EXPECTED: Final = f"expected a plan of QGroundControl (JSON), or waypoints ({HEADER} 110)"


def read_plan(data: bytes, file: str) -> Plan:
    """Read a file; its content, not its name, decides about the format.

    Raises: MissionError with file, line and item.
    """
    if len(data) > SIZE_LIMIT:
        raise MissionError(f"{file}: more than {SIZE_LIMIT} bytes; expected a smaller plan")
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise MissionError(f"{file}:{line}: not UTF-8: {error.reason}; {_EXPECTED}") from error
    if text.startswith(HEADER):
        plan = read_waypoints(text, file)
    elif text.lstrip().startswith("{"):
        plan = read_ground_plan(text, file)
    else:
        raise MissionError(f"{file}: unknown format; {_EXPECTED}")
    _check_positions(plan)
    return plan


def _check_positions(plan: Plan) -> None:
    """Refuse coordinates outside the Earth; items from number 100 on have other values there."""
    for item in plan.items:
        lat, lon = item.lat_deg, item.lon_deg
        if item.command < 100 and (abs(lat or 0.0) > 90 or abs(lon or 0.0) > 180):
            where = f"{plan.file}:{item.line}: item {item.number}"
            raise MissionError(f"{where}: {lat}, {lon}: expected a latitude and longitude in degrees")
