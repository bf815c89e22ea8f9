"""The file `channels.toml`: settings of channels from the start of the broker on."""

from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.config import load
from swarmware.types.channel import (
    NO_SETTINGS,
    RATE_MAX_HZ,
    ChannelLimit,
    ChannelPriority,
    ChannelProtocol,
    ChannelSettings,
    check_rule_names,
)

FILE: Final = "channels.toml"


class ChannelEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the channels of all resources that match; omitted settings stay unchanged."""

    pattern: str
    """Pattern of paths of this platform: `sensor/lidar/**`."""
    link: str = ""
    """Name or pattern of the receiving platforms: `gcs`, `uav*`; "" selects all."""
    max_hz: float | None = None
    """Maximum rate; 0 sends nothing."""
    adaptive: bool = False
    """Whether the rate follows the link's capacity, up to max_hz: items of streams are dropped before they
    wait."""
    protocol: ChannelProtocol | None = None
    """Protocol: udp (beacons) or zmq (notifications) for boards; rtp (video) for streams of images."""
    compression: str | None = None
    """none, zlib:1 to zlib:9, zstd:1 to zstd:19, jpeg:1 to jpeg:95, auto; h264, which is rtp."""
    buffer_bytes: int | None = None
    """Maximum size of the values that wait during an outage."""
    buffer_s: float | None = None
    """Maximum age of the values that wait during an outage."""
    priority: ChannelPriority | None = None
    """high, normal or low, among the channels to one platform."""

    def __post_init__(self) -> None:
        """Check the settings; msgspec converts ValueError to its ValidationError."""
        check_rule_names(self.pattern, self.link)
        rule = self.rule()
        rule.settings.check()
        if rule.settings == NO_SETTINGS:
            raise InvalidInput(f"channel {self.pattern!r}: expected a setting, such as max_hz or compression")
        # RTP goes to one receiver; beacons to all cannot carry it
        if rule.settings.is_video and not self.link:
            raise InvalidInput(f"channel {self.pattern!r}: video goes to platforms; expected link")

    def rule(self) -> ChannelLimit:
        """The entry as a rule."""
        return ChannelLimit(
            self.pattern,
            ChannelSettings(
                RATE_MAX_HZ if self.adaptive and self.max_hz is None else self.max_hz,
                self.protocol,
                self.compression,
                self.buffer_bytes,
                self.buffer_s,
                self.priority,
                self.adaptive or None,
            ),
            link=self.link,
            from_file=True,
        )


class ChannelsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of channels (channels.toml)."""

    channel: tuple[ChannelEntry, ...] = ()
    """In their order: of each setting, the first entry that matches and has it applies."""


def load_channels(config_dir: Path) -> tuple[ChannelLimit, ...]:
    """The rules of a node's file; none where there is no file.

    Raises: ConfigError when the file is invalid, with file and line.
    """
    path = config_dir / FILE
    config = load(path, ChannelsConfig) if path.exists() else ChannelsConfig()
    return tuple(entry.rule() for entry in config.channel)
