"""Who sent a frame from another platform, as the broker that let it in found out."""

from swarmware.access import Role, Sender
from swarmware.errors import WireError

_SENDER_TAG = 2
"""Element of a header extension: tag, length of what follows, role, platform. Never taken from a link."""


def with_sender(extension: bytes, sender: Sender | None) -> bytes:
    """The extension with this sender; whatever it said of one before is taken out.

    Raises: WireError when it is no list of tagged elements.
    """
    kept = b""
    at = 0
    while at < len(extension):
        end = at + 2 + extension[at + 1] if at + 2 <= len(extension) else len(extension) + 1
        if end > len(extension):
            raise WireError(f"header extension of {len(extension)} bytes: an element ends behind it")
        if extension[at] != _SENDER_TAG:
            kept += extension[at:end]
        at = end
    if sender is None:
        return kept
    name = sender.platform.encode()
    said = bytes((_SENDER_TAG, 1 + len(name), sender.role)) + name
    if len(kept) + len(said) > 255:
        raise WireError(f"header extension of {len(extension)} bytes: no room for the sender")
    return kept + said


def sender_of(extension: bytes) -> Sender | None:
    """The sender in an extension; None: this platform itself, or a swarm without keys."""
    at = 0
    while at + 2 <= len(extension):
        tag, end = extension[at], at + 2 + extension[at + 1]
        if tag == _SENDER_TAG and at + 3 <= end <= len(extension) and extension[at + 2] in _ROLES:
            return Sender(extension[at + 3 : end].decode("ascii", "replace"), Role(extension[at + 2]))
        at = end
    return None


_ROLES = frozenset(Role)
