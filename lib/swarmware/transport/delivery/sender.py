"""Sender and time of arrival of a frame, added by the broker that received it from a link."""

import struct
from functools import lru_cache
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.access import Role, Sender
from swarmware.model.frame import EXTENSION_LIMIT

_SENDER_TAG: Final = 2
"""Element of a header extension: tag, length of what follows, role, platform. Never taken from a link."""
_ARRIVAL_TAG: Final = 3
_ARRIVAL: Final = struct.Struct("<BBq")
"""Element of a header extension: tag, length of what follows, instant in ns. Never taken from a link."""
_CALLER_TAG: Final = 5
"""Element of a header extension: tag, length of what follows, role, name of the user that sent the frame. The
broker of the sender states it; it is within the signature."""
_VIA_TAG: Final = 7
"""Element of a header extension: tag, length of what follows, names of the platforms that forwarded the
frame, separated by commas. Never taken from a link."""
_OWN_TAGS: Final = frozenset({_SENDER_TAG, _ARRIVAL_TAG, _CALLER_TAG, _VIA_TAG})
_ROLES: Final = frozenset(Role)
_NAME_BYTES: Final = 31


class Caller(msgspec.Struct, frozen=True, gc=False):
    """A user of a platform's computer, whose program sent a frame."""

    name: str
    role: Role


def with_sender(extension: bytes, sender: Sender | None, arrived_ns: int | None = None) -> bytes:
    """The extension with this sender and arrival; former elements of that kind are removed.

    Raises: WireError when it is not a list of tagged elements.
    """
    kept = _without(extension)
    elements = b"" if arrived_ns is None else _ARRIVAL.pack(_ARRIVAL_TAG, 8, arrived_ns)
    if sender is not None:
        elements += _element(sender.platform, sender.role)
        if sender.caller:
            elements += _caller_element(sender.caller, sender.role)
        if sender.via:
            elements += _via_element(sender.via, EXTENSION_LIMIT - len(kept) - len(elements))
    if len(kept) + len(elements) > EXTENSION_LIMIT:
        raise WireError(f"header extension of {len(extension)} bytes: no room for the sender")
    return kept + elements


def with_caller(extension: bytes, caller: Caller | None) -> bytes:
    """The extension with this caller; what it stated before of sender, arrival and caller is removed.

    Raises: WireError when it is not a list of tagged elements, or has no room.
    """
    kept = _without(extension)
    element = b"" if caller is None else _caller_element(caller.name, caller.role)
    if len(kept) + len(element) > EXTENSION_LIMIT:
        raise WireError(f"header extension of {len(extension)} bytes: no room for the caller")
    return kept + element


@lru_cache(maxsize=256)
def _without(extension: bytes) -> bytes:
    kept = b""
    at = 0
    while at < len(extension):
        end = at + 2 + extension[at + 1] if at + 2 <= len(extension) else len(extension) + 1
        # an element that ends behind the extension would swallow the payload
        if end > len(extension):
            raise WireError(f"header extension of {len(extension)} bytes: an element ends behind it")
        # elements of the broker that come from a link are forged, and are removed
        if extension[at] not in _OWN_TAGS:
            kept += extension[at:end]
        at = end
    return kept


@lru_cache(maxsize=256)
def _element(platform: str, role: Role) -> bytes:
    name = platform.encode()
    return bytes((_SENDER_TAG, 1 + len(name), role)) + name


@lru_cache(maxsize=256)
def _caller_element(caller: str, role: Role) -> bytes:
    name = caller.encode()[:_NAME_BYTES]
    return bytes((_CALLER_TAG, 1 + len(name), role)) + name


def _via_element(via: tuple[str, ...], room: int) -> bytes:
    """The last names of the path, as many as there is room for."""
    names = ",".join(via).encode()[-max(0, room - 2) :] if room > 2 else b""
    return bytes((_VIA_TAG, len(names))) + names if names else b""


def _elements(extension: bytes) -> dict[int, bytes]:
    """Content of the first element of each tag; elements that end behind the extension are left out."""
    found: dict[int, bytes] = {}
    at, size = 0, len(extension)
    while at + 2 <= size:
        end = at + 2 + extension[at + 1]
        if end <= size:
            found.setdefault(extension[at], extension[at + 2 : end])
        at = end
    return found


def sender_of(extension: bytes) -> Sender | None:
    """The sender in an extension, or None for this platform itself or a swarm without keys."""
    return _sender_in(_elements(extension))


def sender_and_arrival_ns(extension: bytes) -> tuple[Sender | None, int | None]:
    """The sender as `sender_of`, and the arrival of the frame from a link at this platform's broker.

    Units: own clock in ns, or None if the frame crossed no link.
    """
    found = _elements(extension)
    arrival = found.get(_ARRIVAL_TAG, b"")
    return _sender_in(found), int.from_bytes(arrival, "little", signed=True) if len(arrival) == 8 else None


def _sender_in(found: dict[int, bytes]) -> Sender | None:
    sender = found.get(_SENDER_TAG, b"")
    # a role of a later version has unknown rights: none are given
    if not sender or sender[0] not in _ROLES:
        return None
    return _sender(sender, found.get(_CALLER_TAG, b"")[1:], found.get(_VIA_TAG, b""))


@lru_cache(maxsize=256)
def caller_of(extension: bytes) -> Caller | None:
    """The caller in an extension, or None for the sender's platform itself."""
    content = _elements(extension).get(_CALLER_TAG, b"")
    if len(content) < 2 or content[0] not in _ROLES:
        return None
    return Caller(_printable(content[1 : 1 + _NAME_BYTES]), Role(content[0]))


@lru_cache(maxsize=256)
def _sender(content: bytes, caller: bytes, via: bytes) -> Sender:
    names = tuple(_printable(via).split(",")) if via else ()
    return Sender(_printable(content[1:]), Role(content[0]), _printable(caller), names)


def _printable(name: bytes) -> str:
    text = name.decode("ascii", "replace")
    return "".join(letter if letter.isprintable() else "?" for letter in text)
