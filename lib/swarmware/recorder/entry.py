"""One log entry: a recorded frame and its queue; and the cursor of a consumer."""

from typing import Any

import msgspec

from swarmware.errors import NotFound, WireError
from swarmware.model import names
from swarmware.recorder.payload_type import payload_class
from swarmware.types import registry
from swarmware.types.json_form import plain


class LogEntry(msgspec.Struct, frozen=True, gc=False):
    """One recorded value of a resource."""

    queue: str
    """`<platform>:<module>:<in|out>`: one input and one output queue per functional module (S0.68)."""
    sequence: int
    """Number in the queue, from 1; every missing number is covered by a gap record."""
    platform: str
    path: str
    """Local path."""
    kind: str
    type: str
    stamp_ns: int
    """Clock of the platform when the value was sent."""
    utc_ns: int
    """Wall clock of the logger, for display and queries."""
    payload: bytes
    """MessagePack of the type."""
    sender: str = ""
    """Sender of a command, `swarmctl#1@gcs` or role and platform if authenticated, or "" without one."""
    sent_utc_ns: int = 0
    """`stamp_ns` as wall clock of the logger, or 0 if it is not known."""
    description: str = ""
    """JSON of the `TypeDescription` of a type that a module defines, or "" for other types."""

    @property
    def topic(self) -> str:
        """Global path: platform and local path."""
        return names.join(self.platform, self.path)

    def value(self) -> msgspec.Struct | None:
        """The decoded payload, or None if the type is unknown here or the payload does not match it."""
        try:
            return registry.decode(payload_class(self.type, self.description), self.payload)
        except (NotFound, WireError):
            return None

    def content(self) -> Any:
        """The decoded payload as a Struct, or as plain MessagePack for an unknown type, or None."""
        value = self.value()
        return value if value is not None else list_or_none(self.payload)

    def plain(self) -> Any:
        """The payload as dictionaries and lists with field names, for output, JSON and databases.

        None when it is not MessagePack, or nested deeper than the interpreter follows.
        """
        try:
            return plain(self.content())
        except RecursionError:
            return None


def list_or_none(payload: bytes) -> Any:
    """A payload of unknown type, decoded as plain MessagePack, or None if it is not MessagePack."""
    try:
        return msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None


class Cursor(msgspec.Struct, frozen=True):
    """Position in a platform's ring up to which entries are stored: forwarding resumes here."""

    segment: int = 0
    """Number of the segment."""
    offset: int = 0
    """Offset in the segment behind the last stored entry, in bytes."""
    sequences: dict[str, int] = {}
    """Last stored sequence number, by queue."""
