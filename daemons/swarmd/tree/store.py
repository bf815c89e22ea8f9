"""Storage of the settings that were changed, in one file."""

import logging
from pathlib import Path

import msgspec
import tomli_w

from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.model.clock import utc_ns
from swarmware.model.resource import Plain
from swarmware.runtime.filewriter import replace_file

log = logging.getLogger("swarm.tree")


class StoredSetting(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A setting that was changed."""

    value: Plain
    version: int
    """Number of its changes."""
    before: Plain | None = None
    """Value before the last change, for one undo."""


class SettingsStore:
    """The file `settings.toml`, which is replaced atomically."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: dict[str, StoredSetting] = {}
        self._load()

    def _load(self) -> None:
        try:
            raw = document.toml(document.read(self._path), str(self._path), finite=False)
            self._kept = msgspec.convert(raw, dict[str, StoredSetting])
        except FileNotFoundError:
            return
        except (OSError, ConfigError, msgspec.ValidationError) as error:
            aside = self._path.with_suffix(f".broken-{utc_ns()}")
            try:
                self._path.rename(aside)
            except OSError:
                aside = self._path
            log.error("%s: cannot be used (%s); kept as %s, defaults are in force", self._path, error, aside)

    def get(self, path: str) -> StoredSetting | None:
        """The stored setting; None: the default applies."""
        return self._kept.get(path)

    def put(self, path: str, value: Plain, before: Plain) -> StoredSetting:
        """Store a new value on the disk.

        Raises: OSError if it cannot be written; nothing has changed then.
        """
        old = self._kept.get(path)
        kept = StoredSetting(value=value, version=(old.version if old else 0) + 1, before=before)
        fresh = {**self._kept, path: kept}
        self._save(fresh)
        self._kept = fresh
        return kept

    def _save(self, kept: dict[str, StoredSetting]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        content = tomli_w.dumps({path: msgspec.to_builtins(one) for path, one in sorted(kept.items())})
        replace_file(self._path, content.encode())
