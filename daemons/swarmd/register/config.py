"""Settings of the register (services/register.toml)."""

from typing import Annotated

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Platforms whose application tables are kept, and the time after which they are removed."""

    partners: str = "*"
    """Pattern of platforms whose applications are known here, or "" for this platform only."""
    forget_s: Annotated[float, msgspec.Meta(ge=1, le=86_400)] = 600.0
    """Time without a route or a new table after which a platform is removed."""
