"""Actions of the tree's core, which the shell executes; it reports results by events."""

from collections.abc import Mapping
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.compression import Compression
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.model.names import MAIN, hardware_id
from swarmware.model.resource import Resource
from swarmware.types.tree_exchange import StructureRequest, SubscribeRequest, TreeItem, TreeNotify

_KINDS: Final = (FrameKind.NOTIFY, FrameKind.STREAM, FrameKind.BOARD, FrameKind.FILE)
"""Kind of frame of each lane."""


class RequestStructure(msgspec.Struct, frozen=True, gc=False):
    """Request `sys/tree/structure`; the reply goes to `on_structure`."""

    platform: str
    request: StructureRequest


class RequestSubscription(msgspec.Struct, frozen=True, gc=False):
    """Request `sys/tree/subscribe`; the reply goes to `on_subscribed`."""

    platform: str
    request: SubscribeRequest


class Coding(msgspec.Struct, frozen=True, gc=False):
    """How the values of a resource are sent to one subscriber."""

    type: str
    """Type of the values."""
    compression: Compression
    reads: frozenset[str]
    """Methods and layouts that the subscriber reads."""


class SendNotify(msgspec.Struct, frozen=True, gc=False):
    """Send a message to `sys/tree/notify`; its outcome goes to `on_notified`."""

    platform: str
    notify: TreeNotify
    codings: Mapping[str, Coding] = {}
    """Compression of the values by path; a path without an entry is not compressed."""

    @property
    def kind(self) -> FrameKind:
        """Kind of frame of the lane, which sets the priority on a link."""
        # a notification is acknowledged in every lane; only its priority differs
        return _KINDS[self.notify.lane]


class Watch(msgspec.Struct, frozen=True, gc=False):
    """Watch an own resource; each value goes to `on_value`."""

    resource: Resource


class Unwatch(msgspec.Struct, frozen=True, gc=False):
    """Stop watching a resource: it has no subscribers."""

    path: str


class RemoveMirrors(msgspec.Struct, frozen=True, gc=False):
    """Remove the mirrors of a platform that was not reachable for too long."""

    platform: str


class WriteMirror(msgspec.Struct, frozen=True, gc=False):
    """Write a value of another node to its mirror."""

    platform: str
    """Platform of the mirror, or the node if the mirror holds values of exactly one computer."""
    item: TreeItem
    epoch: int
    """Epoch of the tree that sent the value; after a restart, numbers and stamps begin again."""
    unit: str = MAIN
    """Computer of the platform that sent it."""
    late: bool = False
    """A former value of a board, for the readers of its history."""

    @property
    def frame(self) -> Frame:
        """The frame as its owner made it. Raises: WireError for an unknown kind or codec."""
        item = self.item
        try:
            kind, codec = FrameKind(item.kind), Codec(item.codec)
        except ValueError as error:
            raise WireError(f"notification of /{self.platform}/{item.path}: {error}") from error
        return Frame(
            kind,
            item.data_id,
            hardware_id(self.platform, self.unit),
            sequence=item.sequence,
            stamp_ns=item.stamp_ns,
            codec=codec,
            payload=item.data,
        )


class PruneMirrors(msgspec.Struct, frozen=True, gc=False):
    """Remove the mirrors of a platform except the mirrors of these resources."""

    platform: str
    paths: frozenset[str]


Action = (
    RequestStructure
    | RequestSubscription
    | SendNotify
    | Watch
    | Unwatch
    | RemoveMirrors
    | PruneMirrors
    | WriteMirror
)
