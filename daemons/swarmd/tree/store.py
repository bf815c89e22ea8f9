"""Settings of this platform: kept in one file, read by everybody as boards."""

import logging
import tomllib
from pathlib import Path

import msgspec
import tomli_w

from swarmware.clock import utc_ns
from swarmware.resource import Plain

log = logging.getLogger("swarm.tree")


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """One setting that differs from its default."""

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
            raw = tomllib.loads(self._path.read_text("utf-8"))
            self._kept = msgspec.convert(raw, dict[str, Kept])
        except FileNotFoundError:
            return
        except (OSError, ValueError, msgspec.ValidationError) as error:
            aside = self._path.with_suffix(f".broken-{utc_ns()}")
            try:
                self._path.rename(aside)
            except OSError:
                aside = self._path
            log.error("%s: cannot be used (%s); kept as %s, defaults are in force", self._path, error, aside)

    def get(self, path: str) -> Kept | None:
        """What was set; None: the default holds."""
        return self._kept.get(path)

    def put(self, path: str, value: Plain, before: Plain | None) -> Kept:
        """Keeps a new value.

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
        raw = {
            path: {key: value for key, value in msgspec.to_builtins(one).items() if value is not None}
            for path, one in sorted(kept.items())
        }
        fresh = self._path.with_suffix(".new")
        with fresh.open("wb") as file:
            tomli_w.dump(raw, file)
            file.flush()
        fresh.replace(self._path)
