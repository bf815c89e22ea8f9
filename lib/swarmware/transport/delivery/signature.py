"""Signature and path of a frame that other members forward, in the extension of its header."""

import struct
from collections.abc import Callable
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.footprint.blake2b import blake2b
from swarmware.model.frame import EXTENSION_LIMIT, Frame, encode_header

_SIGNATURE_TAG: Final = 4
_SIGNATURE: Final = struct.Struct("<BBIQ64s")
"""Last element of a header extension: tag, length of what follows, hardware id and session of the signer,
Ed25519 signature."""
_SIGNATURE_LENGTH: Final = _SIGNATURE.size - 2
SIGNATURE_ELEMENT_BYTES: Final = _SIGNATURE.size
_PATH_TAG: Final = 6
"""First element of a header extension: tag, length of what follows, hardware id of each node that forwarded
the frame."""
_NODE: Final = struct.Struct("<I")
_SIGNER: Final = struct.Struct("<IQ")
_PERSON: Final = b"swarmware frame1"
_PREFIX: Final = b"swarmware frame signature 1"
"""Keeps a signature of a frame from being one of anything else that the same key signs."""


class FrameSignature(msgspec.Struct, frozen=True, gc=False):
    """A signature in the extension of a frame."""

    signer_hw: int
    session: int
    """Session of the signer's broker."""
    value: bytes


class RelayExtension(msgspec.Struct, frozen=True, gc=False):
    """The extension of a frame from a link, in its parts."""

    extension: bytes
    """Without path and signature."""
    path: tuple[int, ...]
    """Nodes that forwarded the frame, the first one first."""
    signature: FrameSignature | None


def split(extension: bytes) -> RelayExtension:
    """The parts of an extension.

    Raises: WireError when the path ends behind it.
    """
    path: tuple[int, ...] = ()
    start, end = 0, len(extension)
    if end >= 2 and extension[0] == _PATH_TAG:
        start = 2 + extension[1]
        if start > end or extension[1] % _NODE.size:
            raise WireError(f"header extension of {end} bytes: its path has {extension[1]} bytes")
        path = tuple(hw for (hw,) in _NODE.iter_unpack(extension[2:start]))
    signature = None
    at = end - SIGNATURE_ELEMENT_BYTES
    if at >= start and is_signed(extension):
        _, _, signer_hw, session, value = _SIGNATURE.unpack_from(extension, at)
        signature = FrameSignature(signer_hw, session, value)
        end = at
    return RelayExtension(extension[start:end], path, signature)


def is_relayed(extension: bytes) -> bool:
    """Whether the extension has a path or a signature."""
    return (len(extension) >= 2 and extension[0] == _PATH_TAG) or is_signed(extension)


def is_signed(extension: bytes) -> bool:
    """Whether the extension ends with a signature."""
    at = len(extension) - SIGNATURE_ELEMENT_BYTES
    return at >= 0 and extension[at] == _SIGNATURE_TAG and extension[at + 1] == _SIGNATURE_LENGTH


def with_node(extension: bytes, hw: int) -> bytes:
    """The extension with one more node on the path; unchanged where it has no room."""
    # the path is information; the frame itself must not fail for it
    if len(extension) + 2 + _NODE.size > EXTENSION_LIMIT:
        return extension
    if len(extension) >= 2 and extension[0] == _PATH_TAG and 2 + extension[1] <= len(extension):
        end = 2 + extension[1]
        return b"".join(
            (bytes((_PATH_TAG, extension[1] + _NODE.size)), extension[2:end], _NODE.pack(hw), extension[end:])
        )
    return b"".join((bytes((_PATH_TAG, _NODE.size)), _NODE.pack(hw), extension))


def signed_extension(frame: Frame, signer_hw: int, session: int, signing: Callable[[bytes], bytes]) -> bytes:
    """The extension of a frame with its signature; a former path and signature are removed.

    Raises: WireError when the extension has no room for it.
    """
    extension = split(frame.extension).extension
    if len(extension) + SIGNATURE_ELEMENT_BYTES > EXTENSION_LIMIT:
        raise WireError(f"header extension of {len(extension)} bytes: no room for a signature")
    value = signing(_content(frame, extension, signer_hw, session))
    return extension + _SIGNATURE.pack(_SIGNATURE_TAG, _SIGNATURE_LENGTH, signer_hw, session, value)


def signed_content(frame: Frame, parts: RelayExtension) -> bytes:
    """The bytes that the signer has signed: of the whole frame, without hops left and path."""
    assert parts.signature is not None
    return _content(frame, parts.extension, parts.signature.signer_hw, parts.signature.session)


def _content(frame: Frame, extension: bytes, signer_hw: int, session: int) -> bytes:
    """A digest, since Ed25519 reads its text twice, and libsodium copies it."""
    digest = blake2b(_SIGNER.pack(signer_hw, session), person=_PERSON, digest_size=32)
    # hops left change at each hop, so they are signed as 0
    digest.update(encode_header(frame, 0, len(extension)))
    digest.update(extension)
    digest.update(frame.payload)
    return _PREFIX + digest.digest()
