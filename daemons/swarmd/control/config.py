"""Settings of the control daemon (services/control.toml)."""

from typing import Annotated

import msgspec

Limit = Annotated[float, msgspec.Meta(gt=0, le=100)]


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driving by hand: how long a manual set-point holds, and its limits."""

    manual_timeout_s: Annotated[float, msgspec.Meta(ge=0.05, le=2)] = 0.3
    """Age beyond which a manual set-point has expired: then the vehicle holds."""
    speed_max_m_s: Limit = 3.0
    """Maximum horizontal speed of a manual set-point; a faster one is limited to it."""
    climb_max_m_s: Limit = 1.5
    """Maximum climb and sink rate of a manual set-point."""
    turn_max_rad_s: Limit = 1.0
    """Maximum yaw rate of a manual set-point."""
