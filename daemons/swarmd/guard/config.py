"""Settings of the guard (services/guard.toml)."""

from typing import Annotated, Literal

import msgspec

from swarmware.errors import InvalidInput


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Start of the services, detection of hung services, and limits of restarts."""

    supervisor: Literal["self", "systemd"] = "self"
    """Supervisor that starts the processes of services: the guard itself, or systemd at its request."""
    hung_s: Annotated[float, msgspec.Meta(ge=1.5, le=600)] = 5.0
    """Time without a heartbeat after which a service is killed and restarted; heartbeats come every
    second."""
    start_s: Annotated[float, msgspec.Meta(ge=1, le=600)] = 20.0
    """Maximum time from the start of a process until its service has joined the node."""
    back_off_s: tuple[Annotated[float, msgspec.Meta(ge=0, le=600)], ...] = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
    """Pauses before consecutive restarts after failed starts; the last pause applies to all further
    restarts."""
    settled_s: Annotated[float, msgspec.Meta(ge=0.1, le=3600)] = 1.0
    """Time on the node after which the end of a service is not a failed start, and has no pause."""
    restart_limit: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 30
    """Consecutive failed starts after which the guard gives a service up, or 0 to retry without limit."""
    priorities: bool = True
    """Set priorities and cores of the services' processes by their load; no effect with one process for all
    services."""
    stop_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 3.0
    """Time after which a service that was requested to end is killed."""

    def __post_init__(self) -> None:
        """Checks that there is at least one pause."""
        if not self.back_off_s:
            raise InvalidInput("back_off_s: empty; expected at least one pause")
