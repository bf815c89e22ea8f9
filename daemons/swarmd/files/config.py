"""Settings of the files of a node (services/files.toml)."""

from typing import Annotated

import msgspec

from swarmware.transport.transfer.block_set import FILE_BYTES_MAX


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where files are stored, and how many bytes of them."""

    folder: str = ""
    """Folder of the files; empty: `files` in the data folder of the node."""
    limit_bytes: Annotated[int, msgspec.Meta(ge=0, le=1 << 50)] = 1024**3
    """Bytes of all files together; more are refused."""
    file_limit_bytes: Annotated[int, msgspec.Meta(ge=0, le=FILE_BYTES_MAX)] = 256 * 1024**2
    """Bytes of one file; a larger one is refused."""
    keep_parts_s: Annotated[float, msgspec.Meta(ge=0)] = 86_400.0
    """Time after which the blocks of an incomplete file are removed."""
