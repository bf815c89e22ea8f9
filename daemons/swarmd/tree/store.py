"""Settings of this platform that differ from their defaults, kept in one file."""

import logging
from pathlib import Path

import msgspec
import tomli_w

from swarmware import document
from swarmware.clock import utc_ns
from swarmware.errors import ConfigError
from swarmware.filewriter import replace_file
from swarmware.resource import Plain

log = logging.getLogger("swarm.tree")


class Kept(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One setting that was changed."""

    value: Plain
    version: int
    """Counts its changes."""
    before: Plain | None = None
    """For one undo."""


class Store:
    """`settings.toml`: replaced whole, so it is the old one or the new one, never half of each."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: dict[str, Kept] = {}
        self._load()

    def _load(self) -> None:
        try:
            raw = document.toml(document.read(self._path), str(self._path), finite=False)
            self._kept = msgspec.convert(raw, dict[str, Kept])
        except FileNotFoundError:
            return
        except (OSError, ConfigError, msgspec.ValidationError) as error:
            aside = self._path.with_suffix(f".broken-{utc_ns()}")
            try:
                self._path.rename(aside)
            except OSError:
                aside = self._path
            log.error("%s: cannot be used (%s); kept as %s, defaults are in force", self._path, error, aside)

    def get(self, path: str) -> Kept | None:
        """What was set; None: the default holds."""
        return self._kept.get(path)

    def put(self, path: str, value: Plain, before: Plain) -> Kept:
        """Keeps a new value; it is on the disk afterwards.

        Raises: OSError when it cannot be written; nothing has changed then.
        """
        old = self._kept.get(path)
        kept = Kept(value=value, version=(old.version if old else 0) + 1, before=before)
        fresh = {**self._kept, path: kept}
        self._save(fresh)
        self._kept = fresh
        return kept

    def _save(self, kept: dict[str, Kept]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        content = tomli_w.dumps({path: msgspec.to_builtins(one) for path, one in sorted(kept.items())})
        replace_file(self._path, content.encode())
