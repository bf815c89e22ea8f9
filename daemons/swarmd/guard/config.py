"""Settings of the guard (services/guard.toml)."""

from typing import Annotated, Literal

import msgspec

from swarmware.errors import InvalidInput


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How services are started, when one counts as hung, and how often it is restarted."""

    supervisor: Literal["self", "systemd"] = "self"
    """Which supervisor starts the processes of services: the guard itself, or systemd at its request."""
    hung_s: Annotated[float, msgspec.Meta(ge=1.5, le=600)] = 5.0
    """Time without a heartbeat after which a service is killed and restarted; one is written every second."""
    start_s: Annotated[float, msgspec.Meta(ge=1, le=600)] = 20.0
    """Time from the start of a process until its service has joined the node."""
    back_off_s: tuple[Annotated[float, msgspec.Meta(ge=0, le=600)], ...] = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
    """Pause before the first, second, … restart in a row after a failed start; the last one from then on."""
    settled_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600)] = 1.0
    """Time on the node after which the end of a service is not a failed start: no pause."""
    restart_limit: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 30
    """Consecutive failed starts after which the guard gives up until an operator restarts it; 0: never."""
    priorities: bool = True
    """Whether priorities and cores of the processes of services are set by their load; not with one process
    for all services."""
    stop_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 3.0
    """Time that a service has to end before it is killed."""

    def __post_init__(self) -> None:
        """Check constraints between fields."""
        if not self.back_off_s:
            raise InvalidInput("back_off_s: empty; expected at least one pause")
