"""Settings of time synchronisation (services/timesync.toml)."""

from typing import Annotated

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How conversion functions are found and how long they are kept."""

    window_s: Annotated[float, msgspec.Meta(ge=10, le=600)] = 60.0
    """Exchanges older than this are forgotten; longer is more exact and slower to follow a drifting clock."""
    solve_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 3.0
    """Longest time until a function is found again while exchanges come; a young one, and one that an
    exchange contradicts, is found sooner."""
    publish_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 1.0
    """Least time between two lists on the board; a first value or a step is published at once."""
    forget_s: Annotated[float, msgspec.Meta(ge=60, le=604_800)] = 3600.0
    """A unit not heard of for so long loses its function: events of those who meet rarely stay in order."""
    functions_limit: Annotated[int, msgspec.Meta(ge=1, le=4096)] = 128
    """Functions on the board; of more, the best known."""
    compose: bool = True
    """Whether units that are not heard directly are converted over the neighbours on the way to them."""
