"""Extra parts of a beacon about trees: the structure of the sender, and questions for those of others."""

import struct
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.errors import WireError

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_STRUCTURE: Final = 4
"""Type of the part with the structure of the sender's tree."""
_QUESTIONS: Final = 5
"""Type of the part with the nodes whose structure the sender needs."""
_HEAD: Final = struct.Struct("<IQQB")
"""Epoch, digest, digest of the template, bytes of the signature."""
_HARDWARE: Final = struct.Struct("<I")
_SIGNED: Final = struct.Struct("<IQIQQ")
_PREFIX: Final = b"swarmware structure signature 1"
"""Keeps a signature of a structure from being one of anything else that the same key signs."""
SIGNATURE_BYTES: Final = 64
"""Of Ed25519; a node without keys sends none."""


class StructurePart(msgspec.Struct, frozen=True, gc=False):
    """Structure of the sender's tree, as changes to a template."""

    epoch: int
    digest: int
    base: int
    """Digest of the template."""
    data: bytes
    """Changes to the template, as `StructureReply.data`."""
    signature: bytes = b""
    """Of the sender; empty without keys."""


def signed_content(hw: int, session: int, part: StructurePart) -> bytes:
    """What the sender signs: the structure, itself and the session of its broker."""
    return _PREFIX + _SIGNED.pack(hw, session, part.epoch, part.digest, part.base) + part.data


def structure_bytes(part: StructurePart | None) -> int:
    """Encoded size of a structure."""
    return 0 if part is None else _PART.size + _HEAD.size + len(part.signature) + len(part.data)


def question_bytes(count: int) -> int:
    """Encoded size of questions for `count` nodes."""
    return _PART.size + count * _HARDWARE.size if count else 0


def encode_structure(part: StructurePart) -> bytes:
    """Encodes a structure as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    head = _HEAD.pack(part.epoch, part.digest, part.base, len(part.signature))
    body = head + part.signature + part.data
    return _PART.pack(_STRUCTURE, len(body)) + body


def encode_questions(nodes: Iterable[int]) -> bytes:
    """Encodes questions as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    body = b"".join([_HARDWARE.pack(hw) for hw in nodes])
    return _PART.pack(_QUESTIONS, len(body)) + body


def decode(data: bytes, at: int) -> tuple[StructurePart | None, tuple[int, ...]]:
    """Structure and questions in the extra parts from an offset, whose lengths fit the body.

    Raises: struct.error when a part is cut short, WireError for a signature of another size.
    """
    structure: StructurePart | None = None
    questions: tuple[int, ...] = ()
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _STRUCTURE:
            structure = _decode_structure(data[at : at + length])
        elif kind == _QUESTIONS:
            questions = tuple([hw for (hw,) in _HARDWARE.iter_unpack(data[at : at + length])])
        at += length
    return structure, questions


def _decode_structure(body: bytes) -> StructurePart:
    epoch, digest, base, size = _HEAD.unpack_from(body)
    end = _HEAD.size + size
    if size not in (0, SIGNATURE_BYTES) or end > len(body):
        raise WireError(f"structure of {len(body)} bytes: a signature of {size} bytes does not fit")
    return StructurePart(epoch, digest, base, body[end:], body[_HEAD.size : end])
