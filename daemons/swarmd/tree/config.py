"""Settings of the tree (services/tree.toml)."""

from typing import Annotated, Final

import msgspec

from swarmware.names import Pattern, check_path
from swarmware.types.tree import Rule

KEPT: Final = ("nav/pose", "power/battery", "vehicle/state", "mission/state")
"""At a ground station: where a lost vehicle was, how much energy it had, what it was doing."""
Seconds = Annotated[float, msgspec.Meta(ge=0, le=86_400)]
Pause = Annotated[float, msgspec.Meta(gt=0, le=600)]


class RuleConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When values of other platforms are worth a notification to us."""

    pattern: str
    """Of local paths: `power/**`."""
    deadband: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    """A number must differ by more than this from the value sent last; 0: any change."""
    min_interval_s: Annotated[float, msgspec.Meta(ge=0, le=3600)] = 0.0
    """Least time between two notifications."""
    max_interval_s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] = 0.0
    """Told again after this even without a change; 0: never."""

    def __post_init__(self) -> None:
        Pattern(self.pattern)

    def rule(self) -> Rule:
        """The same for the wire."""
        return Rule(self.pattern, self.deadband, self.min_interval_s, self.max_interval_s)


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How patient and how eager the tree is."""

    lost_s: Seconds = 3.0
    """From an owner's end to `lost`; a restart by the guard takes less."""
    expire_s: Seconds = 60.0
    """From `lost` to the removal of what only that owner had named."""
    coalesce_s: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.2
    """A change of the structure waits so long for others to go with it."""
    min_interval_s: Annotated[float, msgspec.Meta(ge=0, le=60)] = 0.1
    """Least time between two notifications of one board, where nothing else is said."""
    lease_s: Annotated[float, msgspec.Meta(ge=1, le=3600)] = 120.0
    """A subscription of a platform out of reach for so long ends; after half of it that platform asks."""
    retry_s: tuple[Pause, ...] = (0.2, 0.5, 1.0, 2.0, 5.0)
    """Pauses after failures in a row."""
    forget_s: Seconds = 600.0
    """A platform that was away so long is forgotten, with its mirrors."""
    answer_s: Pause = 2.0
    """Longest wait for the answer of another tree."""
    whole_swarm: bool = False
    """Keep up with the trees of all platforms; else of neighbours, and of those that somebody here reads."""
    keep: tuple[str, ...] | None = None
    """Local paths of every other platform whose newest value is kept, once a second, for the case that the
    platform is lost; left out: pose, battery and state at a ground station, nothing on a vehicle."""
    rules: tuple[RuleConfig, ...] = ()
    """The first that matches a path holds for it."""

    def __post_init__(self) -> None:
        if not self.retry_s:
            raise ValueError("retry_s: empty; expected at least one pause")
        for path in self.keep or ():
            check_path(path)

    def kept(self, kind: str) -> tuple[str, ...]:
        """What is kept at a node of this kind."""
        if self.keep is not None:
            return self.keep
        return KEPT if kind == "gcs" else ()
