"""Settings of the guard (services/guard.toml)."""

from typing import Annotated, Literal

import msgspec


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How services are started, when one counts as hung, and how often it is tried again."""

    supervisor: Literal["self", "systemd"] = "self"
    """Who starts processes where each service has its own: the guard itself, or systemd on its request."""
    hung_s: Annotated[float, msgspec.Meta(ge=1.5, le=600)] = 5.0
    """A service without a beat for so long is killed and started again; a beat comes every second."""
    start_s: Annotated[float, msgspec.Meta(ge=1, le=600)] = 20.0
    """Time from the start of a process until its service has joined the node."""
    back_off_s: tuple[Annotated[float, msgspec.Meta(ge=0, le=600)], ...] = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
    """Pause before the first, second, … restart in a row; the last one from then on."""
    settled_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600)] = 10.0
    """A service that ran for so long is restarted without a pause again."""
    restart_limit: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 30
    """Restarts in a row after which the guard gives up until it is told to try again; 0: never."""
    stop_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 3.0
    """Time that a service has to end before it is killed."""

    def __post_init__(self) -> None:
        """Checks what the types cannot say."""
        if not self.back_off_s:
            raise ValueError("back_off_s: empty; expected one pause at least")
