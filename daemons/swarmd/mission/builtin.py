"""The built-in missions: available without network, with priority over every user mission (S2.37)."""

from typing import Final

from swarmware.mission.binding import Binding
from swarmware.mission.loader import load
from swarmware.mission.model import MissionDefinition
from swarmware.model.platform_kind import VEHICLES, PlatformKind

TEXTS: Final = {
    "land": """{"mission": {
        "start": {"type": "Start", "next": "land"},
        "land": {"type": "Land", "next": "disarm", "on": {"no_position": "land"}},
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
    "hold": """{"mission": {
        "start": {"type": "Start", "next": "hold"},
        "hold": {"type": "Hold", "next": "end"},
        "end": {"type": "End"}
    }}""",
}


def built_in(platform: str, kind: PlatformKind) -> dict[str, MissionDefinition]:
    """The built-in missions of a platform of this kind; a ground station has none: nothing is to be made
    safe."""
    if kind not in VEHICLES:
        return {}
    binding = Binding(platform, kind)
    return {name: load(text, f"built-in {name}", binding) for name, text in TEXTS.items()}
