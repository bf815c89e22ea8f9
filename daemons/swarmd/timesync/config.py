"""Settings of time synchronisation (services/timesync.toml)."""

from typing import Annotated

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Estimation and lifetime of the conversion functions."""

    window_s: Annotated[float, msgspec.Meta(ge=10, le=600)] = 60.0
    """Window of the exchanges; a longer window is more accurate, and follows a drifting clock more slowly."""
    solve_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 3.0
    """Maximum time between two estimations while exchanges arrive; new or contradicted functions are
    estimated sooner."""
    publish_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 1.0
    """Minimum time between two publications; a first function or a clock step is published at once."""
    forget_s: Annotated[float, msgspec.Meta(ge=60, le=604_800)] = 3600.0
    """Time without exchanges after which a function is removed; long, for nodes that meet rarely."""
    functions_limit: Annotated[int, msgspec.Meta(ge=1, le=4096)] = 128
    """Maximum number of published functions; the functions with the largest bounds are left out."""
    compose: bool = True
    """Compose the functions of units out of direct range over the neighbours on the route to them."""
