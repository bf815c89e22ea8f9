"""Answers: of a request to its caller, of a message to its sender."""

import msgspec

from swarmware.types.registry import register


@register
class Empty(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Nothing to say beyond that it is said."""


@register
class Reply(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer to a request."""

    ok: bool
    body: bytes = b""
    """MessagePack of the reply type, when ok."""
    kind: str = ""
    """Class name of the error, when not ok."""
    error: str = ""
    """What was wrong, where, and what was expected."""


@register
class Ack(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What became of a message."""

    status: int
    """`delivery.Status` value."""
    where: str = ""
    """Hop at which it stopped, as platform or platform:application."""
    detail: str = ""
    """Reason, when it was not delivered."""
    received_ns: int = 0
    """Receiver's hardware clock when it was put into the inbox."""
