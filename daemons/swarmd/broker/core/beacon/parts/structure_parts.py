"""Extra parts of a beacon about trees: structure of the sender, and questions for other structures."""

import struct
from collections.abc import Iterable
from typing import Final

import msgspec

_PART: Final = struct.Struct("<BH")
"""Type and length of an extra part of a body."""
_STRUCTURE: Final = 4
"""Type of the part with the structure of the sender's tree."""
_QUESTIONS: Final = 5
"""Type of the part with the nodes whose structure the sender needs."""
_HEAD: Final = struct.Struct("<IQQ")
"""Epoch, digest, digest of the template."""
_HARDWARE: Final = struct.Struct("<I")


class StructurePart(msgspec.Struct, frozen=True, gc=False):
    """Structure of the sender's tree, as changes to a template."""

    epoch: int
    digest: int
    base: int
    """Digest of the template."""
    data: bytes
    """Changes to the template, as `StructureReply.data`."""


def structure_bytes(part: StructurePart | None) -> int:
    """Encoded size of a structure."""
    return 0 if part is None else _PART.size + _HEAD.size + len(part.data)


def question_bytes(count: int) -> int:
    """Encoded size of questions for `count` nodes."""
    return _PART.size + count * _HARDWARE.size if count else 0


def encode_structure(part: StructurePart) -> bytes:
    """Encodes a structure as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    body = _HEAD.pack(part.epoch, part.digest, part.base) + part.data
    return _PART.pack(_STRUCTURE, len(body)) + body


def encode_questions(nodes: Iterable[int]) -> bytes:
    """Encodes questions as an extra part of the body.

    Raises: struct.error when a number does not fit its field.
    """
    body = b"".join([_HARDWARE.pack(hw) for hw in nodes])
    return _PART.pack(_QUESTIONS, len(body)) + body


def decode(data: bytes, at: int) -> tuple[StructurePart | None, tuple[int, ...]]:
    """Structure and questions in the extra parts from an offset, whose lengths fit the body.

    Raises: struct.error when a part is cut short.
    """
    structure: StructurePart | None = None
    questions: tuple[int, ...] = ()
    while at < len(data):
        kind, length = _PART.unpack_from(data, at)
        at += _PART.size
        if kind == _STRUCTURE:
            body = data[at : at + length]
            epoch, digest, base = _HEAD.unpack_from(body)
            structure = StructurePart(epoch, digest, base, body[_HEAD.size :])
        elif kind == _QUESTIONS:
            questions = tuple([hw for (hw,) in _HARDWARE.iter_unpack(data[at : at + length])])
        at += length
    return structure, questions
