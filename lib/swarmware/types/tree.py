"""The resource tree between processes and platforms: requests, structures, subscriptions, notifications."""

from typing import Annotated, Final, Self

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.model.resource import Kind, Resource
from swarmware.types.bounds import Count, Finite, Hertz, Instant, PathText, Seconds, Uint16, Uint32
from swarmware.types.registry import register

PATTERNS_LIMIT: Final = 1000
"""Maximum patterns of one subscription: ten times the number for all modules of a node."""
RULES_LIMIT: Final = 200
BOARD_LIMITS_LIMIT: Final = 64
"""Limits of rates that concern one subscriber; an operator sets a handful."""


class Quality(OpenEnum):
    """Quality of a resource's value as received here."""

    LIVE = "live"
    STALE = "stale"
    """Older than it may be, or of unknown age."""
    LOST = "lost"
    """Its owner has ended, or its platform is unreachable."""
    NONE = "none"
    """No value has arrived here."""


class ValueSource(OpenEnum):
    """Origin of a value."""

    OWN = "own"
    """This platform has the resource."""
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
    """Version of the value now set; 0 when it was forwarded to an application, which versions it itself."""
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
    """Former value as text; empty when it is unknown."""
    after: str
    refused: str = ""
    """Reason of a refusal; empty when it was executed."""
    via: tuple[str, ...] = ()
    """Platforms that forwarded the request, the first one first; () if it came directly. Only the last one is
    authenticated."""


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


@register
class TreeStats(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Work of the tree service since its start (board `tree/stats`)."""

    resources: int = 0
    platforms: int = 0
    """Other platforms whose structure is known."""
    requests_sent: int = 0
    """Requests to other platforms: structures, subscriptions, values."""
    requests_answered: int = 0
    subscribers: int = 0
    """Platforms with a subscription here."""
    feeds: int = 0
    """Pairs of subscriber and resource that are served by notification."""
    notifications_sent: int = 0
    """Messages acknowledged by their receivers."""
    values_sent: int = 0
    """Values in acknowledged notifications."""
    notifications_received: int = 0
    values_received: int = 0
    notify_failures: int = 0
    """Messages that were not acknowledged; their content was sent again."""
    events_dropped: int = 0
    """Events that were dropped from a subscriber's full queue."""
    refused: int = 0
    """Items of other platforms, and own operations, that failed and were skipped."""
    digest: int = 0
    """Digest of this platform's structure."""
    followed: int = 0
    """Reachable platforms that this one follows: neighbours, and platforms whose data its applications
    read."""
    structures: int = 0
    """Followed platforms whose local structure digest matches the announced one."""
    subscriptions: int = 0
    """Followed platforms that hold this platform's subscription by digest, or need none."""
    denied: int = 0
    """Requests that the rules of access do not permit their senders."""


@register
class StreamLoss(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Items of one stream or event that were lost for one subscriber."""

    path: str
    platform: str
    """Platform of the subscriber."""
    items: int
    """Number of items since the tree service started."""


@register
class StreamLosses(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Items that were lost because a subscriber or its link was too slow (board `tree/losses`)."""

    losses: tuple[StreamLoss, ...] = ()


# -- between the trees of two platforms


@register
class StructureRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/structure`: step 2 of S0.55."""

    platform: str
    """Platform of the requester."""
    epoch: Count
    digest: int
    """Epoch and digest of the requester's own tree, for the other direction."""
    held: int = 0
    """Digest of the structure that the requester already has, or 0 without one."""
    full: bool = False
    """True if the requester does not have the template of the former answer and needs the whole structure."""


@register
class StructureReply(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/structure` (S0.56)."""

    epoch: Count
    """Changes with each start of the owner's tree service."""
    digest: int
    """Digest of the owner's structure, which the requester has after applying `data`."""
    form: int
    """0 unchanged, 1 changes to the held structure, 2 changes to a template, 3 everything."""
    base: int = 0
    """Digest of the template, in form 2 and 3."""
    data: bytes = b""
    """zlib (with the preset dictionary of share/doc/protocol.md, section 14, or none) of MessagePack: the
    template's resources (form 3 only) and the changes."""


@register
class SubscribeRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/subscribe`: the subscription of one platform at another, or its renewal."""

    platform: str
    """Platform of the subscriber."""
    epoch: Count
    """Epoch of the subscriber's tree service: after a restart it has lost its values."""
    set_digest: int
    """Digest of `patterns` and `rules`."""
    lease_s: Seconds
    held: int = 0
    """Digest of the structure that the subscriber has."""
    renew: bool = False
    """Patterns and rules are omitted, because the owner should have them."""
    patterns: Annotated[tuple[PathText, ...], msgspec.Meta(max_length=PATTERNS_LIMIT)] = ()
    """Local paths and patterns; they may match nothing yet."""
    rules: Annotated[tuple[Rule, ...], msgspec.Meta(max_length=RULES_LIMIT)] = ()
    """Rules; the first that matches a path applies."""
    reads: Annotated[tuple[str, ...], msgspec.Meta(max_length=32)] = ()
    """Compressions that the subscriber reads: `zlib`, `zstd`, and layouts of records."""


@register
class BoardLimit(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Limit of the rate at which the owner sends boards, set by an operator."""

    pattern: PathText
    """Local paths of the owner."""
    max_hz: Hertz
    """Maximum rate; 0 sends nothing."""


BoardLimits = Annotated[tuple[BoardLimit, ...], msgspec.Meta(max_length=BOARD_LIMITS_LIMIT)]
"""Rules; the first that matches a path applies."""


@register
class SubscribeReply(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/subscribe`."""

    epoch: Count
    digest: int
    """Epoch and digest of the owner's tree."""
    unknown: bool = False
    """The renewed subscription is unknown here: send it completely."""
    limits: BoardLimits = ()
    """Limits in force for the subscribed resources, whose values come less often than their rate."""


@register
class TreeItem(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One value in a notification."""

    path: PathText
    """Local path at the owner."""
    data_id: Uint32
    kind: Uint16
    """Frame kind: board, event or stream."""
    sequence: Count
    stamp_ns: Instant
    """Hardware clock of the owner."""
    data: bytes
    """Payload as the owner wrote it."""
    codec: int = 0


@register
class TreeNotify(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Message to `sys/tree/notify`: changed values, and the change of the structure (S0.59)."""

    platform: str
    """Platform of the owner."""
    epoch: Count
    serial: Count
    """Counts the notifications of one lane in one epoch, without gaps: the receiver takes them in order."""
    items: tuple[TreeItem, ...] = ()
    base: int = 0
    """Digest of the structure before the change, or 0 without a change of the structure."""
    digest: int = 0
    structure: bytes = b""
    """Changes in the form 1 of `StructureReply.data`."""
    lane: Annotated[int, msgspec.Meta(ge=0, le=3)] = 0
    """Lane: 0 for events, settings and the structure, 1 for streams, 2 for boards, 3 for former values of
    boards. Each lane counts its own serials."""
    first: Count = 0
    """Oldest serial of the lane that the owner still retransmits, or 0 for this notification's serial."""
    lapsed: bool = False
    """The owner has no subscription of the receiver any more; all other fields are empty."""
    limits: BoardLimits | None = None
    """Limits now in force for the subscribed resources, or None if they have not changed."""
