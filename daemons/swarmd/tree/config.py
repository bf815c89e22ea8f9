"""Settings of the tree (services/tree.toml)."""

from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.names import Pattern, check_path
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.tree import Rule

KEPT: Final = ("nav/pose", "power/battery", "vehicle/state", "mission/state")
"""At a ground station: where a lost vehicle was, how much energy it had, what it was doing."""
Seconds = Annotated[float, msgspec.Meta(ge=0, le=86_400)]
Pause = Annotated[float, msgspec.Meta(gt=0, le=600)]


class RuleConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When other platforms send a notification of a value."""

    pattern: str
    """Pattern of local paths: `power/**`."""
    deadband: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    """A number must differ by more than this from the value sent last, or 0 if any change is sent."""
    min_interval_s: Annotated[float, msgspec.Meta(ge=0, le=3600)] = 0.0
    """Minimum time between two notifications, unless the owner of the value has set its rate."""
    max_interval_s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] = 0.0
    """Time after which a value is sent again without a change, or 0 if never."""

    def __post_init__(self) -> None:
        Pattern(self.pattern)

    def rule(self) -> Rule:
        """The rule in wire format."""
        return Rule(self.pattern, self.deadband, self.min_interval_s, self.max_interval_s)


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Times, intervals and rules of the tree."""

    lost_s: Seconds = 3.0
    """From an owner's end to `lost`; a restart by the guard takes less."""
    expire_s: Seconds = 60.0
    """From `lost` to the removal of resources that are not in the template."""
    coalesce_s: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.2
    """Delay of a change of the structure, so that several are sent together."""
    min_interval_s: Annotated[float, msgspec.Meta(ge=0, le=60)] = 0.1
    """Minimum time between two notifications of a board, unless a rule sets its rate."""
    lease_s: Annotated[float, msgspec.Meta(ge=1, le=3600)] = 120.0
    """Time for which a platform may be unreachable before its subscription ends; it is renewed after half of
    that."""
    retry_s: tuple[Pause, ...] = (0.2, 0.5, 1.0, 2.0, 5.0)
    """Pauses after failures in a row."""
    forget_s: Seconds = 600.0
    """Time without reachability after which a platform is removed with its mirrors."""
    broadcast_s: Seconds = 2.0
    """Time to wait for the structure of a neighbour in its beacons before a request, or 0 to request it at
    once."""
    answer_s: Pause = 2.0
    """Time-out of requests to other trees."""
    whole_swarm: bool = False
    """Replicate the trees of all platforms; else of neighbours, and of those with a subscription."""
    keep: tuple[str, ...] | None = None
    """Local paths of every other platform whose newest value is kept, once a second, for the case that the
    platform is lost; by default pose, battery and state at a ground station, nothing on a vehicle."""
    rules: tuple[RuleConfig, ...] = ()
    """Rules; the first that matches a path applies."""

    def __post_init__(self) -> None:
        # the last pause applies to all later failures, so there must be one
        if not self.retry_s:
            raise InvalidInput("retry_s: empty; expected at least one pause")
        for path in self.keep or ():
            check_path(path)

    def kept(self, kind: PlatformKind) -> tuple[str, ...]:
        """Paths that are kept at a node of this kind."""
        if self.keep is not None:
            return self.keep
        # a vehicle has no operator to show last values to, and each subscription costs airtime
        return KEPT if kind == PlatformKind.GCS else ()
