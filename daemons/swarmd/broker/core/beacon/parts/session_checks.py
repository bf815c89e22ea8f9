"""Extra parts of a beacon: questions and answers about sessions; frame port and roster version of a hello."""

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

from swarmware.errors import WireError

_CHECK: Final = struct.Struct("<BII")
_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_CHECKS: Final = 1
"""Type of the part with session checks; other types are skipped."""
_FRAME_PORT: Final = 2
"""Type of the part with the port for frames, beside a hello."""
_PORT_BYTES: Final = 2
PORT_PART_BYTES: Final = _PART.size + _PORT_BYTES
_ROSTER: Final = 3
"""Type of the part with the version of the roster, beside a hello."""
_ROSTER_BYTES: Final = 4
ROSTER_PART_BYTES: Final = _PART.size + _ROSTER_BYTES


class CheckKind(IntEnum):
    """Kind of a session check."""

    QUESTION = 1
    """Is this your present session? The answer names ours."""
    ANSWER = 2
    """This is your present session: your datagrams are received now."""
    PROVE = 3
    """As QUESTION, with proof over a connection: another session of yours is accepted."""


class SessionCheck(NamedTuple):
    """A question or answer about a session."""

    kind: int
    hw: int
    """Addressed node."""
    digest: int
    """BLAKE2b-32 of that node's session."""


def body_bytes(count: int) -> int:
    """Encoded size of `count` checks."""
    return _PART.size + count * _CHECK.size if count else 0


def encode(checks: Iterable[SessionCheck]) -> bytes:
    """Encodes checks as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    part = b"".join([_CHECK.pack(*check) for check in checks])
    return _PART.pack(_CHECKS, len(part)) + part


def encode_port(port: int) -> bytes:
    """Encodes the port for frames as an extra part of the body.

    Raises: OverflowError when it does not fit its field.
    """
    return _PART.pack(_FRAME_PORT, _PORT_BYTES) + port.to_bytes(_PORT_BYTES, "little")


def encode_roster_version(version: int) -> bytes:
    """Encodes the version of the roster as an extra part of the body.

    Raises: OverflowError when it does not fit its field.
    """
    return _PART.pack(_ROSTER, _ROSTER_BYTES) + version.to_bytes(_ROSTER_BYTES, "little")


def decode_hello_parts(data: bytes, at: int) -> tuple[int, int]:
    """Port for frames and version of the roster in the extra parts from an offset, which `decode` accepts;
    0: none."""
    port = version = 0
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _FRAME_PORT and length == _PORT_BYTES:
            port = int.from_bytes(data[at : at + length], "little")
        elif kind == _ROSTER and length == _ROSTER_BYTES:
            version = int.from_bytes(data[at : at + length], "little")
        at += length
    return port, version


def decode(data: bytes, at: int) -> tuple[tuple[SessionCheck, ...], int]:
    """Decodes the extra parts from an offset; returns the checks and their end, perhaps behind the body.

    Raises: struct.error when one is cut short, WireError without any check.
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
