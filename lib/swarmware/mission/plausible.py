"""Heights and distances that no mission means: a wrong unit, a wrong sign, or geographic coordinates."""

import math
from collections.abc import Iterator
from typing import Final

from swarmware.mission.catalogue import Formation, Goto, Takeoff, Waypoints
from swarmware.mission.finding import Remark, Severity
from swarmware.mission.model import Block, MissionDefinition

REACH_M: Final = 50_000.0
"""Maximum distance of a position from the map's origin: an hour of a small fixed wing at 14 m/s, one way."""
CEILING_M: Final = 500.0
"""Maximum height above the map's origin; the open category of the EU ends at 120 m above the ground."""
DEPTH_M: Final = 20.0
"""Maximum depth below the map's origin, for ground vehicles on a slope."""
NEAR_RATIO: Final = 0.8
"""Share of a limit from which there is a warning."""
RULE: Final = "implausible"


def check(mission: MissionDefinition) -> list[Remark]:
    """Remarks about positions beyond the limits (errors), or near to them (warnings)."""
    return [remark for block in mission.blocks.values() for remark in _block(block)]


def _block(block: Block) -> Iterator[Remark]:
    params = block.params
    if isinstance(params, Goto):
        yield from _distance(block, "", params.x_m, params.y_m)
        if params.z_m is not None:
            yield from _height(block, params.z_m)
    elif isinstance(params, Waypoints):
        for number, (x_m, y_m, *z_m) in enumerate(params.points_m):
            yield from _distance(block, f"points_m[{number}]: ", x_m, y_m)
            for height_m in z_m:
                yield from _height(block, height_m)
    elif isinstance(params, Takeoff):
        yield from _height(block, params.altitude_m)
    elif isinstance(params, Formation):
        for number, (x_m, y_m) in enumerate(params.course):
            yield from _distance(block, f"course[{number}]: ", x_m, y_m)
        yield from _distance(block, "offset_m: ", *params.offset_m[:2])
        yield from _height(block, params.offset_m[2])


def _distance(block: Block, what: str, x_m: float, y_m: float) -> Iterator[Remark]:
    distance_m = math.hypot(x_m, y_m)
    text = f"{what}{distance_m:.0f} m from the map's origin"
    yield from _limited(block, distance_m, REACH_M, text, f"at most {REACH_M:g} m (x and y are metres)")


def _height(block: Block, z_m: float) -> Iterator[Remark]:
    if z_m >= 0:
        text = f"a height of {z_m:g} m"
        yield from _limited(block, z_m, CEILING_M, text, f"at most {CEILING_M:g} m")
    else:
        text = f"{-z_m:g} m below the map's origin"
        yield from _limited(block, -z_m, DEPTH_M, text, f"at most {DEPTH_M:g} m (heights are positive)")


def _limited(block: Block, value: float, limit: float, text: str, expected: str) -> Iterator[Remark]:
    if value < NEAR_RATIO * limit:
        return
    severity: Severity = "error" if value > limit else "warning"
    near = "" if value > limit else ", near the limit"
    yield Remark(block.id, severity, RULE, f"{block.id!r}: {text}{near}: expected {expected}")
