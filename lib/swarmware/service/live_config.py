"""Keys of a service's configuration that live settings override, at its start and while it runs."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmware.errors import ConfigError
from swarmware.model import paths
from swarmware.model.resource import Plain
from swarmware.model.stored_setting import FILE, read_settings
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.scalar import Bool, Float, Int, Text

C = TypeVar("C", bound=msgspec.Struct)

_TYPES: Final[Mapping[type, type[msgspec.Struct]]] = {bool: Bool, float: Float, int: Int, str: Text}
"""Type of the setting's resource, by the type of the key's value."""

log = logging.getLogger("swarm.settings")


def value_at(config: msgspec.Struct, key: str) -> Any:
    """The value of a dotted key."""
    found: Any = config
    for part in key.split("."):
        found = getattr(found, part)
    return found


def with_value(config: C, key: str, value: Any) -> C:
    """The configuration with another value of a dotted key; the value is not checked."""
    first, _, rest = key.partition(".")
    return msgspec.structs.replace(
        config, **{first: with_value(getattr(config, first), rest, value) if rest else value}
    )


def overridden(config: C, live_settings: Mapping[str, str], data_path: Path) -> C:
    """The configuration with the stored live settings of the node; an invalid one is logged and ignored.

    `live_settings`: dotted keys, and the keys of the settings that override them.
    """
    if not live_settings:
        return config
    try:
        stored = read_settings(data_path / FILE)
    except FileNotFoundError:
        return config
    except (OSError, ConfigError) as error:
        log.warning("live settings cannot be read, the files apply: %s", error)
        return config
    for key, name in live_settings.items():
        kept = stored.get(paths.setting(name))
        if kept is None or kept.value is None:
            continue
        try:
            config = with_value(config, key, msgspec.convert(kept.value, _type_at(type(config), key)))
        except msgspec.ValidationError as error:
            log.warning("live setting %s is invalid, its file applies: %s", name, error)
    return config


class LiveConfig(Generic[C]):
    """The configuration of a running service with the live settings in force.

    Only what was written after the module has joined is taken: an older value may come from a former file.
    The tree writes the settings of an application again when it joins.
    """

    def __init__(self, module: Module, config: C, live_settings: Mapping[str, str]) -> None:
        self._module = module
        self._config = config
        self._names = live_settings
        self._since_ns = module.entry.started_ns
        self._boards: dict[str, BoardReader[Any]] = {
            key: module.reader(paths.setting(name), _TYPES[type(value_at(config, key))])
            for key, name in live_settings.items()
        }
        self._taken: dict[str, msgspec.Struct | None] = dict.fromkeys(live_settings)

    def take(self) -> C | None:
        """The configuration, if a setting has changed it since the last call."""
        config = self._config
        applied: dict[str, Plain] = {}
        for key, board in self._boards.items():
            value = board.value
            # by identity: equal values are written again after a restart, and must be stated again
            if value is None or value is self._taken[key]:
                continue
            # taken in any case, so that an older value is not examined again
            self._taken[key] = value
            if (board.stamp_ns or 0) >= self._since_ns:
                config = with_value(config, key, value.value)
                applied[self._names[key]] = value.value
        if applied:
            self._module.apply(applied)  # the tree answers the requester with it
        if config == self._config:
            return None
        self._config = config
        return config


def _type_at(cls: type[msgspec.Struct], key: str) -> Any:
    """Type of a dotted key, with its bounds."""
    found: Any = cls
    for part in key.split("."):
        found = next(field.type for field in msgspec.structs.fields(found) if field.name == part)
    return found
