"""Settings of the control daemon (services/control.toml)."""

from typing import Annotated

import msgspec

Limit = Annotated[float, msgspec.Meta(gt=0, le=100)]


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Manual driving: validity and limits of a manual set-point."""

    manual_timeout_s: Annotated[float, msgspec.Meta(ge=0.05, le=2)] = 0.3
    """Age at which a manual set-point expires and the vehicle holds."""
    speed_max_m_s: Limit = 3.0
    """Maximum horizontal speed of a manual set-point; a faster set-point is reduced to this speed."""
    climb_max_m_s: Limit = 1.5
    """Maximum climb and sink rate of a manual set-point."""
    turn_max_rad_s: Limit = 1.0
    """Maximum yaw rate of a manual set-point."""
