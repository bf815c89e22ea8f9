"""Extra part of a beacon with the proofs of its relayed values, one for all that came in one beacon."""

import struct
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import RelayedValue
from swarmd.broker.core.beacon.parts.value_proof import (
    HASH_BYTES,
    SIGNATURE_BYTES,
    ValueProof,
    restore,
    value_hash,
)
from swarmware.errors import WireError

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_PROOFS: Final = 10
"""Type of the part with proofs."""
PART_HEAD_BYTES: Final = _PART.size
_HEAD: Final = struct.Struct(f"<BBQ{HASH_BYTES}s{SIGNATURE_BYTES}s")
"""Relayed values that it proves, values in the beacon of their origin, session, hash of body, signature."""


def group_bytes(proof: ValueProof, positions: Sequence[int]) -> int:
    """Encoded size of the proof of the values at these positions of one beacon."""
    return _HEAD.size + len(positions) + HASH_BYTES * len(proof.further(positions))


def proofs_bytes(relays: Iterable[RelayedValue]) -> int:
    """Encoded size of the proofs of relayed values."""
    sizes = [group_bytes(proof, [relay.position for relay in group]) for proof, group in _groups(relays)]
    return PART_HEAD_BYTES + sum(sizes) if sizes else 0


def encode_proofs(relays: Iterable[RelayedValue]) -> bytes:
    """Encodes the proofs as an extra part of the body, empty without; the values of one beacon are in a row.

    Raises: struct.error or ValueError when a number does not fit its field.
    """
    out: list[bytes] = []
    for proof, group in _groups(relays):
        positions = [relay.position for relay in group]
        head = _HEAD.pack(len(positions), proof.count, proof.session, proof.body, proof.signature)
        out += (head, bytes(positions), *proof.further(positions))
    body = b"".join(out)
    return _PART.pack(_PROOFS, len(body)) + body if body else b""


def decode_proofs(data: bytes, at: int, relays: tuple[RelayedValue, ...]) -> tuple[RelayedValue, ...]:
    """The relayed values with their proofs, from the extra parts from an offset, whose lengths fit the body.

    Raises: struct.error or WireError when a proof is cut short, or is of more values than there are.
    """
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _PROOFS:
            return _proven(data[at : at + length], relays)
        at += length
    return relays


def _proven(body: bytes, relays: tuple[RelayedValue, ...]) -> tuple[RelayedValue, ...]:
    found: list[RelayedValue] = []
    at = 0
    while at < len(body):
        size, count, session, hashed, signature = _HEAD.unpack_from(body, at)
        at += _HEAD.size
        group = relays[len(found) : len(found) + size]
        positions = body[at : at + size]
        if len(group) < size or len(positions) < size:
            raise WireError(f"beacon: a proof of {size} relayed values, expected at most {len(group)}")
        at += size
        leaves = {
            position: value_hash(relay.data_id, relay.stamp_us, relay.packed, relay.payload)
            for position, relay in zip(positions, group, strict=True)
        }
        if len(leaves) < size:
            raise WireError(f"beacon: a proof of {size} relayed values names {len(leaves)} positions")
        proof, used = restore(session, hashed, count, leaves, body[at:], signature)
        at += used
        found += [
            msgspec.structs.replace(relay, proof=proof, position=position)
            for position, relay in zip(positions, group, strict=True)
        ]
    return (*found, *relays[len(found) :])


def _groups(relays: Iterable[RelayedValue]) -> list[tuple[ValueProof, list[RelayedValue]]]:
    groups = groupby((relay for relay in relays if relay.proof is not None), lambda relay: id(relay.proof))
    found: list[tuple[ValueProof, list[RelayedValue]]] = []
    for _, group in groups:
        values = list(group)
        if (proof := values[0].proof) is not None:
            found.append((proof, values))
    return found
