"""The configuration of a node as it answers for it: keys of files and live settings, one list."""

from typing import Annotated

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Count, Instant, PathText
from swarmware.types.registry import register

_Text = Annotated[str, msgspec.Meta(max_length=1000)]


class ConfigOrigin(OpenEnum):
    """Origin of a value of the configuration."""

    DEFAULT = "default"
    """Built in, or the first value of a live setting."""
    FILE = "file"
    """The configuration file that the service has read at its start."""
    LIVE = "live"
    """A live setting that was changed; it overrides the file."""


@register
class ConfigQuery(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/node/config`: keys of the configuration by pattern."""

    pattern: PathText = "**"
    """Pattern of keys: `navigator/*`; the place of a key in its file matches, too:
    `navigator/altitude.kp_1_s`."""
    meanings: bool = False
    """With the meaning of each key."""


@register
class ConfigKey(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One key of the configuration with the value in force."""

    name: PathText
    """`broker/tick_hz`: service and key; of a key that a live setting overrides the name of the setting."""
    value: bytes
    """MessagePack of the value in force; of a service that does not run, of its next start."""
    origin: ConfigOrigin
    type: _Text
    """Type as in TOML: `float`, `array of strings`."""
    unit: _Text
    default: bytes
    """MessagePack of the built-in default, or of the first value of a live setting."""
    limits: _Text
    """Permitted values (an interval, a pattern, or a list), or "" if the type is the only limit."""
    live: bool
    """Changes take effect at once; else the file is changed, and the service restarted."""
    service: _Text = ""
    """Service that reads the file (`node` for node.toml), or "" for a live setting without a file."""
    file: _Text = ""
    """Path of the file at the node, which may be missing."""
    key: _Text = ""
    """Dotted key in the file."""
    line: Count = 0
    """Line in the file, or 0 if the file does not have the key."""
    file_value: bytes = b""
    """MessagePack of the value in the present file, or b"" if the file is missing or invalid."""
    pending: bool = False
    """The file was changed since the service has read it: `file_value` needs a restart."""
    running: bool = True
    """Whether the service runs."""
    version: Count = 0
    """Number of changes of a live setting."""
    by: _Text = ""
    """Requester of the last change of a live setting."""
    utc_ns: Instant = 0
    """Wall clock of the platform at the last change, or 0 if there was no change."""
    meaning: _Text = ""


@register
class EffectiveConfig(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/node/config`: the matching keys by service, in the order of their files."""

    platform: str
    keys: tuple[ConfigKey, ...]
    problems: tuple[str, ...] = ()
    """Files that are invalid now: the next start of their services fails."""


@register
class HistoryQuery(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/history`: stored changes of live settings by pattern."""

    pattern: PathText = "**"
    """Pattern of keys, as in ConfigQuery."""


@register
class ConfigChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One change of a live setting."""

    name: PathText
    utc_ns: Instant
    """Wall clock of the platform."""
    by: str
    """Authenticated `role@platform`, or `application@platform` on the platform itself."""
    before: bytes
    """MessagePack of the value in force before the change."""
    after: bytes
    overrode: bool = True
    """False if the value before came from the file or the default."""
    overrides: bool = True
    """False if the value after comes from the file or the default."""


@register
class ConfigHistory(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/tree/history`: the newest change first."""

    platform: str
    changes: tuple[ConfigChange, ...]
