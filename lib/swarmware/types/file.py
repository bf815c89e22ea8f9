"""Files between platforms: offers, blocks and lists."""

from typing import Annotated

import msgspec

from swarmware.types.bounds import FileName, OptionalFileName
from swarmware.types.registry import register

Digest = Annotated[bytes, msgspec.Meta(min_length=32, max_length=32)]
"""BLAKE2b-256 of the content."""
Size = Annotated[int, msgspec.Meta(ge=0, le=4 * 1024**3)]


@register
class FileOffer(msgspec.Struct, frozen=True, array_like=True):
    """A file that a platform is to take."""

    name: FileName
    size_bytes: Size
    digest: Digest


@register
class FileProgress(msgspec.Struct, frozen=True, array_like=True):
    """Progress of a receiver with a file."""

    complete: bool
    """The file is in its place, with this content."""
    missing: tuple[tuple[int, int], ...] = ()
    """First and last number of ranges of missing blocks of 16 KiB, the first 256 ranges."""


@register
class FileBlock(msgspec.Struct, frozen=True, array_like=True):
    """A block of an offered file."""

    name: FileName
    digest: Digest
    offset: Size
    """A multiple of 16 KiB."""
    data: Annotated[bytes, msgspec.Meta(max_length=16_384)]


@register
class FileQuery(msgspec.Struct, frozen=True, array_like=True):
    """Selection of the files that are listed."""

    name: OptionalFileName = ""
    """Name of one file; "" lists all."""


@register
class FileEntry(msgspec.Struct, frozen=True, array_like=True):
    """A file that a platform has."""

    name: str
    size_bytes: int
    modified_ns: int
    """UTC, ns since 1970."""
    digest: bytes = b""
    """BLAKE2b-256 of the content; empty in a list of all."""


@register
class FileListing(msgspec.Struct, frozen=True, array_like=True):
    """Files of a platform."""

    files: tuple[FileEntry, ...]
    free_bytes: int
    """Bytes that the platform takes at most at present."""


@register
class FileRead(msgspec.Struct, frozen=True, array_like=True):
    """A block of a file that is wanted."""

    name: FileName
    digest: Digest
    """Content of which it is a block: another content is refused."""
    offset: Size
    """A multiple of 16 KiB."""


@register
class FileData(msgspec.Struct, frozen=True, array_like=True):
    """Bytes of a file."""

    data: bytes


@register
class FileReceived(msgspec.Struct, frozen=True, array_like=True):
    """Event: a file was stored."""

    name: str
    size_bytes: int
    digest: bytes
    by: str
    """Sender as role or user and platform, or "" for an application of this platform."""
