"""Storage of the settings that were changed, in one file."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
import tomli_w

from swarmware.errors import ConfigError
from swarmware.model.clock import utc_ns
from swarmware.model.stored_setting import HISTORY_LIMIT, SettingChange, StoredSetting, read_settings
from swarmware.runtime.filewriter import replace_file, set_aside

SIZE_LIMIT: Final = 1 << 20
"""Maximum bytes of the file while there is history to remove: a quarter of what a start reads."""

log = logging.getLogger("swarm.tree")


class SettingsStore:
    """The file `settings.toml`, which is replaced atomically."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: dict[str, StoredSetting] = {}
        self._load()

    def _load(self) -> None:
        try:
            self._kept = read_settings(self._path)
        except FileNotFoundError:
            return
        except (OSError, ConfigError) as error:
            # kept aside, not overwritten: the next change would destroy what an operator can repair
            aside = set_aside(self._path, f".broken-{utc_ns()}")
            log.error("%s: cannot be used (%s); kept as %s, defaults are in force", self._path, error, aside)

    def __iter__(self) -> Iterator[tuple[str, StoredSetting]]:
        return iter(sorted(self._kept.items()))

    def get(self, path: str) -> StoredSetting | None:
        """The stored setting, or None if it was never changed."""
        return self._kept.get(path)

    def put(self, path: str, change: SettingChange) -> StoredSetting:
        """Store a change on the disk.

        Raises: OSError if it cannot be written; nothing has changed then.
        """
        old = self._kept.get(path)
        kept = StoredSetting(
            value=change.after if change.overrides else None,
            version=(old.version if old else 0) + 1,
            history=(*(old.history if old else ()), change)[-HISTORY_LIMIT:],
        )
        fresh = {**self._kept, path: kept}
        content = _encoded(fresh)
        # history goes first: values in force must never be dropped
        while len(content) > SIZE_LIMIT and any(len(one.history) > 1 for one in fresh.values()):
            fresh = {path: _shorter(one) for path, one in fresh.items()}
            content = _encoded(fresh)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        # memory follows the disk: after an error both still have the former state
        replace_file(self._path, content)
        self._kept = fresh
        return fresh[path]


def _encoded(kept: dict[str, StoredSetting]) -> bytes:
    return tomli_w.dumps({path: msgspec.to_builtins(one) for path, one in sorted(kept.items())}).encode()


def _shorter(one: StoredSetting) -> StoredSetting:
    """The setting with the newer half of its history."""
    return msgspec.structs.replace(one, history=one.history[len(one.history) // 2 :])
