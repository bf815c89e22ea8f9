"""The built-in missions: available without network, with priority over every user mission (S2.37)."""

from collections.abc import Mapping
from typing import Final

import msgspec

from swarmd.mission.blocks.motions import ForcedArm
from swarmware.errors import InvalidInput
from swarmware.mission import plausible
from swarmware.mission.binding import Binding
from swarmware.mission.flight import below_ground
from swarmware.mission.loader import load
from swarmware.mission.model import MissionDefinition
from swarmware.model.platform_kind import VEHICLES, PlatformKind

TEXTS: Final = {
    "land": """{"mission": {
        "start": {"type": "Start", "next": "land"},
        "land": {"type": "Land", "next": "disarm", "on": {"no_position": "land", "timeout": "land"}},
        "disarm": {"type": "Disarm", "next": "end", "nextTimeout": "end", "nextError": "end"},
        "end": {"type": "End"}
    }}""",
    # any error during the return: it lands at its position, and the return has failed
    "return": """{"mission": {
        "start": {"type": "Start", "next": "back"},
        "back": {"type": "Return", "next": "land", "nextError": "down", "nextTimeout": "down"},
        "land": {"type": "Land", "next": "disarm", "on": {"no_position": "land"}},
        "disarm": {"type": "Disarm", "next": "end", "nextTimeout": "end", "nextError": "end"},
        "down": {"type": "Land", "next": "off", "on": {"no_position": "down"}},
        "off": {"type": "Disarm", "next": "failed", "nextTimeout": "failed", "nextError": "failed"},
        "end": {"type": "End"},
        "failed": {"type": "End", "result": "failed"}
    }}""",
    # without a position and at touch-down speed; the motors stop on the ground
    "emergency-land": """{"mission": {
        "start": {"type": "Start", "next": "down"},
        "down": {"type": "Land", "blind": true, "speed_m_s": $descent, "next": "disarm",
            "nextTimeout": "down"},
        "disarm": {"type": "Disarm", "next": "end", "nextTimeout": "end", "nextError": "end"},
        "end": {"type": "End"}
    }}""",
    "hold": """{"mission": {
        "start": {"type": "Start", "next": "hold"},
        "hold": {"type": "Hold", "next": "end"},
        "end": {"type": "End"}
    }}""",
}


def built_in(
    platform: str, kind: PlatformKind, emergency_descent_m_s: float = 1.0
) -> dict[str, MissionDefinition]:
    """The built-in missions of a platform of this kind; a ground station has none: nothing is to be made
    safe."""
    if kind not in VEHICLES:
        return {}
    binding = Binding(platform, kind)
    texts = {name: text.replace("$descent", f"{emergency_descent_m_s:g}") for name, text in TEXTS.items()}
    return {name: load(text, f"built-in {name}", binding) for name, text in texts.items()}


MANOEUVRES: Final[dict[str, tuple[frozenset[str], frozenset[str]]]] = {
    "takeoff": (frozenset({"altitude_m"}), frozenset({"speed_m_s"})),
    "goto": (frozenset({"x_m", "y_m"}), frozenset({"z_m", "speed_m_s"})),
}
"""Manoeuvres that an operator orders, with the parameters that each needs, and those that it may have."""


def manoeuvre(
    name: str, params: Mapping[str, float], platform: str, kind: PlatformKind, *, force: str = ""
) -> MissionDefinition:
    """The mission of a manoeuvre with its parameters.

    `force`: who forces the take-off of a vehicle that is not ready, and why, or "" if it is refused.
    Raises: InvalidInput for an unknown manoeuvre, a vehicle that cannot fly it, or other parameters;
    MissionError.
    """
    if name not in MANOEUVRES:
        raise InvalidInput(f"manoeuvre {name!r}: unknown; expected one of {', '.join(MANOEUVRES)}")
    needed, others = MANOEUVRES[name]
    if not needed <= set(params) <= needed | others:
        expected = ", ".join([*sorted(needed), *(f"{other} (optional)" for other in sorted(others))])
        raise InvalidInput(f"{name}: parameters {', '.join(sorted(params)) or 'none'}; expected {expected}")
    if name == "takeoff" and kind != PlatformKind.UAV:
        raise InvalidInput(f"takeoff: {platform} ({kind}) does not fly")
    end = {"end": {"type": "End"}}
    if name == "takeoff":
        blocks = {
            "start": {"type": "Start", "next": "arm"},
            "arm": {"type": "Arm", "next": "takeoff"},
            "takeoff": {"type": "Takeoff", "next": "end", **params},
        }
    else:
        blocks = {
            "start": {"type": "Start", "next": "goto"},
            "goto": {"type": "Goto", "next": "end", **params},
        }
    text = msgspec.json.encode({"mission": blocks | end}).decode()
    mission = load(text, f"built-in {name}", Binding(platform, kind))
    remarks = plausible.check(mission) + (below_ground(mission) if kind == PlatformKind.UAV else [])
    for remark in remarks:
        if remark.severity == "error":
            raise InvalidInput(f"{platform}: {remark.message}")
    if force and name == "takeoff":
        arm = msgspec.structs.replace(mission.blocks["arm"], params=ForcedArm(reason=force))
        mission = msgspec.structs.replace(mission, blocks={**mission.blocks, "arm": arm})
    return mission
