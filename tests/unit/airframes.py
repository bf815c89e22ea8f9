"""Airframes of other makes than multirotors, as they are shipped."""

from pathlib import Path
from typing import Final

from swarmware.model.airframe_file import load_airframe
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.model.helicopter_airframe import HelicopterAirframe

SHARE: Final = Path(__file__).parents[2] / "share/swarm"


def aerosonde() -> FixedWingAirframe:
    found = load_airframe(SHARE, "fixed_wing")
    assert isinstance(found, FixedWingAirframe)
    return found


def artis() -> HelicopterAirframe:
    found = load_airframe(SHARE, "helicopter")
    assert isinstance(found, HelicopterAirframe)
    return found
