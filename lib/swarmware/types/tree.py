"""The resource tree between processes and platforms: requests, structures, subscriptions, notifications."""

from typing import Annotated, Final, Self

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.model.resource import Kind, Resource
from swarmware.types.bounds import Finite, Instant, PathText, Seconds
from swarmware.types.registry import register


class Quality(OpenEnum):
    """Quality of a resource's value as received here."""

    LIVE = "live"
    STALE = "stale"
    """Older than it may be, or of unknown age."""
    LOST = "lost"
    """The owner of the resource has ended, or its platform is unreachable."""
    NONE = "none"
    """No value has arrived here."""


class ValueSource(OpenEnum):
    """Origin of a value."""

    OWN = "own"
    """The resource belongs to this platform."""
    MIRROR = "mirror"
    """The copy of another platform's resource that is kept here."""
    ASKED = "asked"
    """The owner, by a request."""


# -- for operators: sys/tree/get, set, undo, list


@register
class TreeGet(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/get`: the newest value of a resource, or of the copy that a node has of it."""

    path: str
    """`nav/pose` of the platform that is asked; `/uav3/nav/pose` for the own node's copy of another
    platform's value."""
    fresh: bool = False
    """Refuse a copy: only the owner has the present value."""


@register
class TreeValue(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A value with its quality and metadata; answer of `sys/tree/get`."""

    path: str
    """Global: `/uav3/nav/pose`."""
    type: str
    data: bytes
    """MessagePack of the type."""
    stamp_ns: Instant
    """Hardware clock of the owner."""
    sequence: int
    version: int
    """Version for compare-and-set: the count of changes of a setting, or else the sequence."""
    age_s: float | None
    """Age of the value, or None if the owner's clock is not known here."""
    quality: Quality
    """`live`, `stale` or `lost`."""
    unit: str = ""
    owner: str = ""
    source: ValueSource = ValueSource.OWN
    measured_hz: float | None = None
    """Rate at which the owner has written the newest values, or None if unknown."""


@register
class TreeSet(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/set`: a new value, or a new value of one field (`nav/goal.z_m`)."""

    path: str
    value: bytes
    """MessagePack of plain data: a number, a text, or a map or list of a Struct's fields."""
    version: int | None = None
    """Compare-and-set: refuse unless the value still has this version."""


@register
class TreeUndo(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/undo`: restore the value before the last change of a setting."""

    path: str


@register
class TreeReset(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/reset`: remove the override of a setting; its file or default applies."""

    path: str


@register
class TreeSetDone(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/set`, `sys/tree/undo` and `sys/tree/reset`."""

    path: str
    version: int
    """Version of the value now set, or 0 if it was forwarded to an application, which versions it itself."""
    type: str
    data: bytes
    """MessagePack of the value now set."""
    applied_by: tuple[str, ...] = ()
    """Applications that have stated that the value of the setting is in force in them."""
    awaited: tuple[str, ...] = ()
    """Applications with the setting that have not stated it in time."""


@register
class TreeList(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/list`: resources by pattern, over the whole swarm as known here."""

    pattern: str = "/**"
    """`/uav*/nav/**`; without a leading slash on the platform that is asked."""
    limit: int = 2000
    after: str = ""
    """Continue after this path, the last one of the previous answer."""


@register
class TypeRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/type`: the description of a payload type; the answer is a `TypeDescription`."""

    name: Annotated[str, msgspec.Meta(max_length=200)]
    platform: str = ""
    """Platform that has the type; "" selects the platform that answers."""


@register
class Rule(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Notification rule of some resources."""

    pattern: PathText
    """Pattern of the local paths to which it applies."""
    deadband: Finite = 0.0
    """Difference from the value sent last above which a number is sent; 0 sends any change."""
    min_interval_s: Seconds = 0.0
    max_interval_s: Seconds = 0.0
    """Interval after which an unchanged value is sent again, or 0 if it is not."""


@register
class TreeEntry(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One resource of an answer of `sys/tree/list`."""

    # no `Resource` inside: that one refuses what contradicts itself or is not known here, but the listing of
    # The entry holds no `Resource`, which refuses contradictions and unknown kinds: a listing of a later
    # version is shown unchanged. The path is global here; age and quality are local to one node.
    path: str
    """Global."""
    kind: Kind
    type: str
    unit: str = ""
    access: str = "r"
    rate_hz: float = 0.0
    category: str = "conditional"
    link: str = "request"
    owner: str = ""
    age_s: float | None = None
    """Age of the value, or None without a value here or a known clock of the owner."""
    quality: Quality = Quality.NONE
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    log: str = "none"
    reply: str = ""
    description: str = ""
    confirm: str = ""
    """Effect of a change, which an operator must confirm, or "" without a confirmation."""
    measured_hz: float | None = None
    """Rate at which the owner has written the newest values, or None if unknown."""
    rule: Rule | None = None
    """Rule of an operator for its notifications, or None without a rule, or if only its owner knows it."""

    @classmethod
    def of(
        cls,
        resource: Resource,
        path: str,
        age_s: float | None,
        quality: Quality,
        measured_hz: float | None = None,
        rule: Rule | None = None,
    ) -> Self:
        """The entry of a resource; `path`: its global path."""
        shared = {field: getattr(resource, field) for field in _OF_RESOURCE}
        return cls(path=path, age_s=age_s, quality=quality, measured_hz=measured_hz, rule=rule, **shared)


_OF_RESOURCE: Final = tuple(
    field
    for field in TreeEntry.__struct_fields__
    if field not in {"path", "age_s", "quality", "measured_hz", "rule"}
)
"""Fields that an entry copies from its resource."""


@register
class TreePlatform(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of the replica of one platform's tree."""

    platform: str
    reachable: bool
    resources: int
    digest: int
    """Digest of the structure, or 0 while it is unknown."""
    followed: bool = True
    """Whether this node keeps its copy of the structure up to date; otherwise it is requested on demand."""


@register
class TreeListing(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/list`."""

    entries: tuple[TreeEntry, ...]
    more: int = 0
    """Number of further matching resources, after the last one in the answer."""
    platforms: tuple[TreePlatform, ...] = ()
    """Every platform whose tree is known here, whether it matches or not."""


@register
class TreeChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Audit of one set or undo (event `tree/changes`)."""

    path: str
    by: str
    """Authenticated `user@platform` or `role@platform`; `application@platform` on the platform itself."""
    before: str
    """Former value as text, or "" if it is unknown."""
    after: str
    refused: str = ""
    """Reason of a refusal, or "" if it was executed."""
    via: tuple[str, ...] = ()
    """Platforms that forwarded the request, the first one first, or () if it came directly. Only the last one
    is authenticated."""


@register
class TreeLogQuery(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/log`: the changes that this platform was asked for, also refused ones."""

    pattern: PathText = "**"
    """Pattern of local paths."""
    by: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """Part of the requester's name; "" selects all requesters."""
    since_utc_ns: int = 0
    """Only changes from this instant on, by the wall clock of the platform."""
    refused: bool = False
    """Only refused changes."""
    limit: int = 100
    """Maximum number of changes; the newest are taken."""


@register
class LoggedChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A change that was asked for, and when."""

    utc_ns: int
    """Wall clock of the platform."""
    change: TreeChange


@register
class TreeLog(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/log`: the newest change first."""

    platform: str
    changes: tuple[LoggedChange, ...] = ()
    more: int = 0
    """Number of older changes that match."""


@register
class TreeRule(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/rule`: the rule by which this platform sends values to all its subscribers.

    Without a deadband, an interval or `reset` it asks for the rules in force.
    """

    pattern: PathText
    """Pattern of local paths."""
    deadband: Finite | None = None
    min_interval_s: Seconds | None = None
    max_interval_s: Seconds | None = None
    """Maximum interval, or None to keep the present one (0 in a new rule)."""
    reset: bool = False
    """Remove the rule of exactly this pattern."""

    @property
    def changes(self) -> bool:
        """Whether the request changes a rule."""
        return self.reset or any(
            value is not None for value in (self.deadband, self.min_interval_s, self.max_interval_s)
        )


@register
class TreeRules(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/rule`: the rules in force; the first whose pattern matches a path applies to it."""

    platform: str
    rules: tuple[Rule, ...] = ()
