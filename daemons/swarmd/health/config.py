"""Settings of the health monitor (services/health.toml)."""

from collections.abc import Callable
from typing import Annotated

import msgspec

from swarmware.errors import InvalidInput
from swarmware.health.criterion import Above, Below


class LimitConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of one field of one resource."""

    check: str
    """Name of the check that these limits make."""
    path: str
    """Local path of the resource."""
    field: str
    """Field of the resource's type."""
    low: bool = False
    """True if values below the limits are faults, False if values above are."""
    warn: float | None = None
    """Limit of a warning, or None for no warning."""
    error: float | None = None
    """Limit of an error, or None for no error."""
    hysteresis: float = 0.0
    """Distance from the limit at which the check passes again."""
    confirm: tuple[Annotated[int, msgspec.Meta(ge=1)], Annotated[int, msgspec.Meta(ge=1)]] = (3, 5)
    """Debouncing as n and m: n of the last m samples must agree, at one sample per second."""

    def __post_init__(self) -> None:
        """Checks the constraints between fields."""
        if self.warn is None and self.error is None:
            raise InvalidInput(f"limit {self.check}: neither warn nor error; expected one of them")
        if self.confirm[0] > self.confirm[1]:
            raise InvalidInput(f"limit {self.check}: confirm {list(self.confirm)}; expected n ≤ m")

    def criterion(self) -> Callable[[float], str]:
        """Creates a criterion with its own hysteresis state."""
        kind = Below if self.low else Above
        return kind(warn=self.warn, error=self.error, hysteresis=self.hysteresis)


LIMITS = (
    LimitConfig(
        check="battery/charge",
        path="power/battery",
        field="remaining_ratio",
        low=True,
        warn=0.3,
        error=0.15,
        hysteresis=0.02,
    ),
    LimitConfig(
        check="gnss/accuracy", path="sensor/gnss", field="h_acc_m", warn=5.0, error=20.0, hysteresis=1.0
    ),
    LimitConfig(
        check="gnss/satellites", path="sensor/gnss", field="satellites", low=True, warn=6.0, error=4.0
    ),
    LimitConfig(
        check="system/memory",
        path="system/load",
        field="memory_used_ratio",
        warn=0.9,
        error=0.97,
        hysteresis=0.02,
    ),
    LimitConfig(
        check="system/disk", path="system/load", field="disk_free_bytes", low=True, warn=5e8, error=5e7
    ),
    LimitConfig(
        check="link/loss",
        path="net/links",
        field="best_loss_ratio",
        warn=0.4,
        hysteresis=0.1,
        confirm=(5, 8),
    ),
    LimitConfig(check="link/waiting", path="net/links", field="waiting_frames", warn=500.0, hysteresis=250.0),
)


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Monitored resources and platforms, times of the monitor, and the treatment of a hung guard."""

    look_hz: Annotated[float, msgspec.Meta(ge=0.5, le=20)] = 2.0
    """Rate of sampling the ages of resources."""
    grace_s: Annotated[float, msgspec.Meta(ge=0, le=600)] = 10.0
    """Grace time after the appearance of a resource, during which the resource is not monitored."""
    clear_s: Annotated[float, msgspec.Meta(ge=0, le=3600)] = 10.0
    """Clear time, for which a check must pass before its fault is cleared."""
    hung_s: Annotated[float, msgspec.Meta(ge=1.5, le=600)] = 4.0
    """Time without a heartbeat after which an application counts as hung; heartbeats come every second."""
    platforms: tuple[str, ...] | None = None
    """Patterns of platforms whose loss is a fault, or None for all at a ground station and none elsewhere."""
    restart_guard: bool = True
    """Kill a hung guard, so that it is restarted; no effect where systemd supervises."""
    sensors: tuple[str, ...] = ("sensor/*", "nav/pose")
    """Patterns of the resources whose validity is part of the platform's state."""
    ignore: tuple[str, ...] = ("app/**", "health/**")
    """Patterns of resources whose age is not monitored."""
    limits: tuple[LimitConfig, ...] = LIMITS
    """Limits of the values of resources."""
