"""Sender and time of arrival of a frame, added by the broker that received it from a link."""

import struct
from functools import lru_cache
from typing import Final

from swarmware.errors import WireError
from swarmware.model.access import Role, Sender
from swarmware.model.frame import EXTENSION_LIMIT

_SENDER_TAG: Final = 2
"""Element of a header extension: tag, length of what follows, role, platform. Never taken from a link."""
_ARRIVAL_TAG: Final = 3
_ARRIVAL: Final = struct.Struct("<BBq")
"""Element of a header extension: tag, length of what follows, instant in ns. Never taken from a link."""
_OWN_TAGS: Final = frozenset({_SENDER_TAG, _ARRIVAL_TAG})


def with_sender(extension: bytes, sender: Sender | None, arrived_ns: int | None = None) -> bytes:
    """The extension with this sender and arrival; former elements of that kind are removed.

    Raises: WireError when it is not a list of tagged elements.
    """
    kept = b""
    at = 0
    while at < len(extension):
        end = at + 2 + extension[at + 1] if at + 2 <= len(extension) else len(extension) + 1
        if end > len(extension):
            raise WireError(f"header extension of {len(extension)} bytes: an element ends behind it")
        if extension[at] not in _OWN_TAGS:
            kept += extension[at:end]
        at = end
    elements = b"" if arrived_ns is None else _ARRIVAL.pack(_ARRIVAL_TAG, 8, arrived_ns)
    if sender is not None:
        elements += _element(sender)
    if len(kept) + len(elements) > EXTENSION_LIMIT:
        raise WireError(f"header extension of {len(extension)} bytes: no room for the sender")
    return kept + elements


@lru_cache(maxsize=256)
def _element(sender: Sender) -> bytes:
    name = sender.platform.encode()
    return bytes((_SENDER_TAG, 1 + len(name), sender.role)) + name


def sender_of(extension: bytes) -> Sender | None:
    """The sender in an extension; None: this platform itself, or a swarm without keys."""
    at, size = 0, len(extension)
    while at + 2 <= size:
        tag, end = extension[at], at + 2 + extension[at + 1]
        if tag == _SENDER_TAG and at + 3 <= end <= size and extension[at + 2] in _ROLES:
            return _sender(extension[at + 2 : end])
        at = end
    return None


@lru_cache(maxsize=256)
def _sender(content: bytes) -> Sender:
    return Sender(content[1:].decode("ascii", "replace"), Role(content[0]))


def arrival_ns(extension: bytes) -> int | None:
    """When this platform's broker received the frame from a link, on the own clock; None: from no link."""
    at, size = 0, len(extension)
    while at + 2 <= size:
        if extension[at] == _ARRIVAL_TAG and extension[at + 1] == 8 and at + 10 <= size:
            return int(_ARRIVAL.unpack_from(extension, at)[2])
        at += 2 + extension[at + 1]
    return None


_ROLES = frozenset(Role)
