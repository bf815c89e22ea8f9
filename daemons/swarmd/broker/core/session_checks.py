"""Questions and answers about sessions, as they ride in a beacon."""

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

from swarmware.errors import WireError

_CHECK: Final = struct.Struct("<BII")
_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_CHECKS: Final = 1
"""Type of the one with questions and answers about sessions; others are skipped."""


class CheckKind(IntEnum):
    """What one node has to say of another one's session."""

    QUESTION = 1
    """Is this your present session? Answer by naming ours."""
    ANSWER = 2
    """This is your present session: we hear you now."""
    PROVE = 3
    """As QUESTION, and prove it over a connection: we believe another session of yours."""


class SessionCheck(NamedTuple):
    """A question or answer about a session."""

    kind: int
    hw: int
    """Whom it is for."""
    digest: int
    """Of that node's session, BLAKE2b-32."""


def body_bytes(count: int) -> int:
    """Bytes that so many take in the body."""
    return _PART.size + count * _CHECK.size if count else 0


def encode(checks: Iterable[SessionCheck]) -> bytes:
    """The extra part of a body that has them. Raises: struct.error when a number does not fit its field."""
    part = b"".join([_CHECK.pack(*check) for check in checks])
    return _PART.pack(_CHECKS, len(part)) + part


def decode(data: bytes, at: int) -> tuple[tuple[SessionCheck, ...], int]:
    """The checks among the extra parts that begin there, and where those end: perhaps behind the body.

    Raises: struct.error when one is cut short, WireError when there is none.
    """
    if at >= len(data):
        raise WireError(f"beacon of {len(data)} bytes: its extra parts are missing")
    found: tuple[SessionCheck, ...] = ()
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _CHECKS:
            found = tuple([SessionCheck(*check) for check in _CHECK.iter_unpack(data[at : at + length])])
        at += length
    return found, at
