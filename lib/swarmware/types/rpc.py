"""Answers to requests and messages."""

import msgspec

from swarmware.types.registry import register


@register
class Empty(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A request or reply without content."""


@register
class Reply(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer to a request."""

    ok: bool
    body: bytes = b""
    """MessagePack of the reply type, when ok."""
    kind: str = ""
    """Class name of the error, when not ok."""
    error: str = ""
    """Message of the error: the invalid value, its place, and the expected value."""


@register
class Ack(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Outcome of a message."""

    status: int
    """`delivery.Status` value."""
    where: str = ""
    """Hop at which it stopped, as platform or platform:application."""
    detail: str = ""
    """Reason, when it was not delivered."""
    received_ns: int = 0
    """Receiver's hardware clock when it was put into the inbox."""


@register
class StreamSnapshot(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of the owner of a stream after one of its items."""

    sequence: int
    """Sequence of the newest item in the state, or 0 without an item."""
    stamp_ns: int
    """Hardware clock of the owner when the state was taken."""
    body: bytes
    """MessagePack of the type of the state."""
