"""One entry of the record: a frame that was logged, with the queue it belongs to."""

from functools import lru_cache
from typing import Any

import msgspec

from swarmware import names
from swarmware.errors import NotFound, WireError
from swarmware.types import registry


class Entry(msgspec.Struct, frozen=True, gc=False):
    """A logged value."""

    queue: str
    """`<platform>:<module>:<in|out>`: one input and one output queue per functional module (S0.68)."""
    sequence: int
    """Of the queue, from 1, without a hole unless a gap says so."""
    platform: str
    path: str
    """Local path."""
    kind: str
    type: str
    stamp_ns: int
    """Clock of the platform when the value was sent."""
    utc_ns: int
    """Wall clock of the logger, for people."""
    payload: bytes
    """MessagePack of the type."""
    sender: str = ""
    """Who sent it, of commands: `swarmctl#1@gcs`, or the role and platform that its connection proved."""

    @property
    def topic(self) -> str:
        """Global path."""
        return names.join(self.platform, self.path)

    def value(self) -> msgspec.Struct | None:
        """The decoded payload, or None when its type is not known here or does not fit."""
        try:
            return registry.decode(registry.find(self.type), self.payload)
        except (NotFound, WireError):
            return None

    def plain(self) -> Any:
        """The payload as dictionaries and lists with field names, for people, JSON and databases."""
        value = self.value()
        return plain(value if value is not None else list_or_none(self.payload))


def list_or_none(payload: bytes) -> Any:
    """The bare MessagePack of a payload whose type is unknown; None when it is not even that."""
    try:
        return msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None


def plain(value: Any) -> Any:
    """A Struct as a dictionary with its field names, at any depth."""
    if isinstance(value, msgspec.Struct):
        return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bytes | memoryview):
        return f"{len(value)} bytes"
    if isinstance(value, msgspec.msgpack.Ext):
        return f"{len(bytes(value.data))} bytes"
    return value


@lru_cache(maxsize=256)
def schema(type_name: str) -> bytes:
    """JSON Schema of a type's MessagePack, for readers that are not ours; empty when the type is unknown."""
    try:
        return msgspec.json.encode(msgspec.json.schema(registry.find(type_name)))
    except (NotFound, TypeError):
        return b""
