"""Settings of the register (services/register.toml)."""

from typing import Annotated

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which platforms' registers are kept, and for how long."""

    partners: str = "*"
    """Pattern of platforms whose applications are known here; empty: only this platform."""
    forget_s: Annotated[float, msgspec.Meta(ge=1, le=86_400)] = 600.0
    """Time without a message or a route after which a platform is removed."""
