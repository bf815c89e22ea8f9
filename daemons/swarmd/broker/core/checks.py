"""Questions and answers about sessions, as they ride in a tick."""

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

_CHECK: Final = struct.Struct("<BII")
_EXTRA_BYTES: Final = 3
"""Type and length before them in the body."""


class CheckKind(IntEnum):
    """What one node has to say of another one's session."""

    QUESTION = 1
    """Is this your present session? Answer by naming ours."""
    ANSWER = 2
    """This is your present session: we hear you now."""
    PROVE = 3
    """As QUESTION, and prove it over a connection: we believe another session of yours."""


class Check(NamedTuple):
    """A question or answer about a session."""

    kind: int
    hw: int
    """Whom it is for."""
    digest: int
    """Of that node's session, BLAKE2b-32."""


def body_bytes(count: int) -> int:
    """Bytes that so many take in the body."""
    return _EXTRA_BYTES + count * _CHECK.size if count else 0


def encode(checks: Iterable[Check]) -> bytes:
    """The checks one after the other. Raises: struct.error when a number does not fit its field."""
    return b"".join([_CHECK.pack(*check) for check in checks])


def decode(part: bytes) -> tuple[Check, ...]:
    """The checks in these bytes. Raises: struct.error when they are cut short."""
    return tuple([Check(*check) for check in _CHECK.iter_unpack(part)])
