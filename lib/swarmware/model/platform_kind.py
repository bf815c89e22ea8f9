"""The kinds of platforms, by what they do."""

from typing import Final

from swarmware.model.open_enum import OpenEnum


class PlatformKind(OpenEnum):
    """Kind of a platform; a platform of a later version may have another one."""

    UAV = "uav"
    """Flies."""
    UGV = "ugv"
    USV = "usv"
    """On the surface of the water."""
    GCS = "gcs"
    """Ground station."""


NO_KIND: Final = PlatformKind("")
"""Kind of a platform whose kind is unknown."""
VEHICLES: Final = (PlatformKind.UAV, PlatformKind.UGV, PlatformKind.USV)
"""Kinds that move."""
