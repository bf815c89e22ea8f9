"""What the core wants done; the shell carries it out and tells how it went."""

import msgspec

from swarmware.frame import Kind
from swarmware.resource import Resource
from swarmware.types.tree import StructureRequest, SubscribeRequest, TreeItem, TreeNotify


class AskStructure(msgspec.Struct, frozen=True, gc=False):
    """Request `sys/tree/structure`; tell `on_structure`."""

    platform: str
    request: StructureRequest


class AskSubscription(msgspec.Struct, frozen=True, gc=False):
    """Request `sys/tree/subscribe`; tell `on_subscribed`."""

    platform: str
    request: SubscribeRequest


class SendNotify(msgspec.Struct, frozen=True, gc=False):
    """Send a message to `sys/tree/notify`; tell `on_notified`."""

    platform: str
    notify: TreeNotify

    @property
    def kind(self) -> Kind:
        """How it goes over a link: what is nothing but items of streams lets all else pass."""
        items = self.notify.items
        only_streams = bool(items) and not self.notify.digest and all(i.kind == Kind.STREAM for i in items)
        return Kind.STREAM if only_streams else Kind.NOTIFY


class Watch(msgspec.Struct, frozen=True, gc=False):
    """Look at an own resource; tell each of its values to `on_value`."""

    resource: Resource


class Unwatch(msgspec.Struct, frozen=True, gc=False):
    """Nobody wants its values any more."""

    path: str


class Forget(msgspec.Struct, frozen=True, gc=False):
    """A platform has been away too long: its mirrors go."""

    platform: str


class WriteMirror(msgspec.Struct, frozen=True, gc=False):
    """A value of another platform that is read here."""

    platform: str
    item: TreeItem


class KeepOnly(msgspec.Struct, frozen=True, gc=False):
    """These are all resources of a platform: mirrors of others go."""

    platform: str
    paths: frozenset[str]


Action = AskStructure | AskSubscription | SendNotify | Watch | Unwatch | Forget | KeepOnly | WriteMirror
