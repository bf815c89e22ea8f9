"""Exchange between the trees of two platforms: structures, subscriptions, notifications, their counters."""

from typing import Annotated, Final

import msgspec

from swarmware.types.bounds import Count, Hertz, Instant, PathText, Seconds, Uint16, Uint32
from swarmware.types.registry import register
from swarmware.types.tree import Rule

PATTERNS_LIMIT: Final = 1000
"""Maximum patterns of one subscription: ten times the number for all modules of a node."""
RULES_LIMIT: Final = 200
BOARD_LIMITS_LIMIT: Final = 64
"""Limits of rates that concern one subscriber; an operator sets a handful."""


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
