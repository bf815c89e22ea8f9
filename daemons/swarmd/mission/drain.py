"""The record of a drain: who drained this platform, kept over restarts of the daemon and of the node."""

import logging
from pathlib import Path

import msgspec

from swarmware.errors import ConfigError, SwarmError
from swarmware.model import document
from swarmware.runtime.filewriter import replace_file

log = logging.getLogger("swarm.mission")

UNKNOWN = "unknown"
"""Name shown when the record cannot be read: the platform stays drained, which moves nothing."""


class DrainRecord(msgspec.Struct, frozen=True):
    """Content of the file."""

    by: str
    utc_ns: int


class Drain:
    """Whether this platform takes roles in new missions."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.by = self._load()
        """Operator who drained the platform, or "" if it is not drained."""

    def _load(self) -> str:
        try:
            return document.json(document.read(self._file), DrainRecord, str(self._file)).by or UNKNOWN
        except FileNotFoundError:
            return ""
        except (ConfigError, OSError) as error:
            log.error("%s; the platform stays drained until `swarmctl node undrain`", error)
            return UNKNOWN

    def begin(self, by: str, utc_ns: int) -> None:
        """Record a drain.

        Raises: SwarmError when the record cannot be written; then nothing changes.
        """
        try:
            replace_file(self._file, msgspec.json.encode(DrainRecord(by, utc_ns)))
        except OSError as error:
            raise SwarmError(f"{self._file}: not written, so not drained: {error.strerror}") from error
        self.by = by

    def end(self) -> None:
        """Remove the record.

        Raises: SwarmError when it cannot be removed; then nothing changes.
        """
        try:
            self._file.unlink(missing_ok=True)
        except OSError as error:
            raise SwarmError(f"{self._file}: not removed, so still drained: {error.strerror}") from error
        self.by = ""
