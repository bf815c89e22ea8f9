"""Content of `settings.toml`: the live settings of a platform that were changed, and their history."""

from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.model.resource import Plain, Resource

FILE: Final = "settings.toml"
"""Name of the file, in the data folder of the node."""
HISTORY_LIMIT: Final = 50
"""Changes that are kept of each setting; the oldest is removed first."""


class SettingChange(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One change of a live setting."""

    utc_ns: int
    """Wall clock of the platform."""
    by: str
    """`user@platform` or `role@platform` of the requester; `application@platform` on the platform itself."""
    before: Plain
    """Value in force before the change."""
    after: Plain
    overrode: bool = True
    """False if the value before came from the file or the default."""
    overrides: bool = True
    """False if the value after comes from the file or the default."""


class StoredSetting(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A setting that was changed."""

    value: Plain | None = None
    """Value that overrides the file and the default, or None without an override."""
    version: int
    """Number of its changes."""
    before: Plain | None = None
    """Value before the last change, as version 0.1 stored it: without a history."""
    history: tuple[SettingChange, ...] = ()
    """The newest changes, in their order."""


class LiveValue(NamedTuple):
    """A live setting of the platform."""

    resource: Resource
    value: Plain | None
    """Value in force, or None for the value of its file or the default."""
    stored: StoredSetting | None
    """Stored content, or None if the setting was never changed."""

    @property
    def overrides(self) -> bool:
        """Whether the value overrides its file or its default."""
        return self.stored is not None and self.stored.value is not None


def read_settings(path: Path) -> dict[str, StoredSetting]:
    """The stored settings, by resource path.

    Raises: FileNotFoundError, ConfigError.
    """
    raw = document.toml(document.read(path), str(path), finite=False)
    try:
        return msgspec.convert(raw, dict[str, StoredSetting])
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: not stored settings: {error}") from error
