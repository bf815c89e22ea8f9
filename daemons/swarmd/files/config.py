"""Settings of the files of a node (services/files.toml)."""

from typing import Annotated

import msgspec

from swarmware.transport.transfer.block_set import FILE_BYTES_MAX


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Folder and size limits of the stored files."""

    folder: str = ""
    """Folder of the files, or "" for `files` in the data folder of the node."""
    limit_bytes: Annotated[int, msgspec.Meta(ge=0, le=1 << 50)] = 1024**3
    """Maximum size of all files together; further files are refused."""
    file_limit_bytes: Annotated[int, msgspec.Meta(ge=0, le=FILE_BYTES_MAX)] = 256 * 1024**2
    """Maximum size of one file; a larger file is refused."""
    keep_parts_s: Annotated[float, msgspec.Meta(ge=0)] = 86_400.0
    """Time after which the blocks of an incomplete file are removed."""
