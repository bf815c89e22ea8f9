"""Extra part of a beacon that solicits beacons of silent neighbours, and says how soon the sender answers."""

import struct
from typing import Final, NamedTuple

_PART: Final = struct.Struct("<BHH")
"""Type and length of the part, and the time to answer."""
_HEAD: Final = struct.Struct("<BH")
_SOLICITATION: Final = 11
"""Type of the part."""
_HW: Final = struct.Struct("<I")
_ANSWER: Final = struct.Struct("<H")
ASKED_MAX: Final = 32
"""Limit of neighbours that one beacon asks."""


class Solicitation(NamedTuple):
    """Neighbours that are asked for a beacon, and the time in which the sender answers such a request."""

    answer_ms: int
    """Time from the arrival of a request to its answer at the latest, or 0 if the sender answers none."""
    asked: tuple[int, ...] = ()
    """Hardware ids of the neighbours that are to send a beacon soon."""


def solicitation_bytes(asked: int) -> int:
    """Encoded size of a solicitation of some neighbours."""
    return _PART.size + asked * _HW.size


def encode_solicitation(solicitation: Solicitation) -> bytes:
    """Encodes a solicitation as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    answer_ms, asked = solicitation
    head = _PART.pack(_SOLICITATION, _ANSWER.size + len(asked) * _HW.size, answer_ms)
    return head + b"".join([_HW.pack(hw) for hw in asked])


def decode_solicitation(data: bytes, at: int) -> Solicitation | None:
    """The solicitation in the extra parts from an offset, whose lengths fit the body, or None without one.

    Raises: struct.error when it is cut short.
    """
    while at < len(data):
        kind, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if kind == _SOLICITATION:
            body = data[at : at + length]
            [answer_ms] = _ANSWER.unpack_from(body)
            return Solicitation(answer_ms, tuple([hw for (hw,) in _HW.iter_unpack(body[_ANSWER.size :])]))
        at += length
    return None
