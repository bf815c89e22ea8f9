"""Extra part of a beacon with sequence requests to one neighbour each."""

import struct
from collections.abc import Iterable
from itertools import groupby
from operator import itemgetter
from typing import Final

from swarmd.broker.core.beacon.beacon import NeighbourRequest

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_REQUESTS: Final = 8
"""Type of the part with requests to neighbours."""
_GROUP: Final = struct.Struct("<IB")
"""Neighbour, and number of requests to it."""
_REQUEST: Final = struct.Struct("<IHB")


def request_part_bytes(requests: Iterable[NeighbourRequest]) -> int:
    """Encoded size of requests to neighbours."""
    groups = [len(list(group)) for _, group in groupby(requests, itemgetter(0))]
    return _PART.size + len(groups) * _GROUP.size + sum(groups) * _REQUEST.size if groups else 0


def encode_requests(requests: Iterable[NeighbourRequest]) -> bytes:
    """Encodes requests as an extra part of the body, those in a row to one neighbour together.

    Raises: struct.error when a number does not fit its field.
    """
    out: list[bytes] = []
    for neighbour_hw, group in groupby(requests, itemgetter(0)):
        entries = [_REQUEST.pack(hw, sequence, hops) for _, hw, sequence, hops in group]
        out += [_GROUP.pack(neighbour_hw, len(entries)), *entries]
    body = b"".join(out)
    return _PART.pack(_REQUESTS, len(body)) + body


def decode_requests(data: bytes, at: int) -> tuple[NeighbourRequest, ...]:
    """Requests in the extra parts from an offset, whose lengths fit the body.

    Raises: struct.error when one is cut short.
    """
    found: list[NeighbourRequest] = []
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _REQUESTS:
            _decode_groups(data[at : at + length], found)
        at += length
    return tuple(found)


def _decode_groups(body: bytes, found: list[NeighbourRequest]) -> None:
    at = 0
    while at < len(body):
        neighbour_hw, count = _GROUP.unpack_from(body, at)
        at += _GROUP.size
        for _ in range(count):
            found.append(NeighbourRequest(neighbour_hw, *_REQUEST.unpack_from(body, at)))
            at += _REQUEST.size
