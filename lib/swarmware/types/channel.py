"""Channels: how values travel to other platforms, as operators and the file `channels.toml` set it."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model.compression import Compression, Method
from swarmware.model.names import Pattern
from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register

RATE_MAX_HZ: Final = 1e6
"""A rate above every real one, which lifts the limits of later rules."""
BUFFER_MAX_BYTES: Final = 64 * 1024 * 1024
BUFFER_MAX_S: Final = 3600.0
SPAN_MAX_S: Final = 86_400.0
BEACON_LINK: Final = "*"
"""Link of a board in beacons, which go to all neighbours."""


class ChannelProtocol(OpenEnum):
    """Protocol of the values of a channel."""

    UDP = "udp"
    """Beacons: the newest value only, never sent again."""
    ZMQ = "zmq"
    """Notifications: acknowledged and sent again."""
    RTP = "rtp"
    """Streams of images as H.264 video, which the service `video` sends to the receiver."""


class ChannelPriority(OpenEnum):
    """Order among the channels to one platform."""

    HIGH = "high"
    NORMAL = "normal"
    LOW = "low"


@register
class ChannelSettings(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Settings of a channel, or of a rule, which leaves the fields None that it does not set."""

    max_hz: float | None = None
    """Maximum rate: 0 sends nothing, and 1000000 sets no limit."""
    protocol: ChannelProtocol | None = None
    compression: str | None = None
    """`none`, `zlib:6`, `zstd:3`, `jpeg:80`, `auto`."""
    buffer_bytes: int | None = None
    """Maximum size of the waiting items; the oldest are dropped."""
    buffer_s: float | None = None
    """Maximum age of the waiting items."""
    priority: ChannelPriority | None = None
    adaptive: bool | None = None
    """True if the rate follows the capacity of the link, up to `max_hz`; set together with `max_hz` only."""

    def check(self) -> None:
        """Check each setting. Raises: OutOfRange, or InvalidInput for an unsupported setting."""
        if self.max_hz is not None and not 0 <= self.max_hz <= RATE_MAX_HZ:
            raise OutOfRange(f"max_hz {self.max_hz}: expected 0 to {RATE_MAX_HZ:.0f}")
        if self.adaptive and self.max_hz is None:
            raise InvalidInput(
                f"adaptive without max_hz: expected both, max_hz {RATE_MAX_HZ:.0f} for no limit"
            )
        if self.compression is not None:
            Compression.parse(self.compression)
        if self.buffer_bytes is not None and not 1 <= self.buffer_bytes <= BUFFER_MAX_BYTES:
            raise OutOfRange(f"buffer_bytes {self.buffer_bytes}: expected 1 to {BUFFER_MAX_BYTES}")
        if self.buffer_s is not None and not 0 < self.buffer_s <= BUFFER_MAX_S:
            raise OutOfRange(f"buffer_s {self.buffer_s}: expected more than 0, at most {BUFFER_MAX_S:g}")
        if self.protocol is not None and self.protocol not in tuple(ChannelProtocol):
            raise InvalidInput(f"protocol {self.protocol}: expected {', '.join(ChannelProtocol)}")
        if self.is_video and not (
            self.protocol in (None, ChannelProtocol.RTP) and self._is_h264 is not False
        ):
            raise InvalidInput(
                f"protocol {self.protocol} with compression {self.compression}: expected rtp with h264"
            )
        if self.priority is not None and self.priority not in tuple(ChannelPriority):
            raise InvalidInput(f"priority {self.priority}: expected {', '.join(ChannelPriority)}")

    @property
    def is_video(self) -> bool:
        """Whether images go as video: by protocol or compression, each of which implies the other."""
        return self.protocol == ChannelProtocol.RTP or bool(self._is_h264)

    @property
    def _is_h264(self) -> bool | None:
        """Whether the compression is H.264, or None if no compression is set."""
        return None if self.compression is None else self.compression == Method.H264

    @property
    def rate(self) -> str:
        """The rate as an operator sets it (`5hz`, `max`, `auto`), or "" if it is not set."""
        if self.max_hz is None:
            return ""
        limit = "max" if self.max_hz == RATE_MAX_HZ else f"{self.max_hz:g}hz"
        if self.adaptive:
            return "auto" if limit == "max" else f"auto:{limit}"
        return limit

    def __str__(self) -> str:
        """The settings as an operator sets them: `--rate 5hz --compress zlib:6`."""
        words = []
        if self.max_hz is not None:
            words.append(f"--rate {self.rate}")
        for option, value in (
            ("protocol", self.protocol),
            ("compress", self.compression),
            ("priority", self.priority),
        ):
            if value is not None:
                words.append(f"--{option} {value}")
        if self.buffer:
            words.append(f"--buffer {self.buffer}")
        return " ".join(words)

    @property
    def buffer(self) -> str:
        """Size and time of the buffer as an operator sets them (`2MB/30s`), or "" if neither is set."""
        size = "" if self.buffer_bytes is None else _size_text(self.buffer_bytes)
        age = "" if self.buffer_s is None else f"{self.buffer_s:g}s"
        return "/".join(filter(None, (size, age)))


def _size_text(size: int) -> str:
    for unit, factor in (("MB", 1_000_000), ("kB", 1000)):
        if size % factor == 0:
            return f"{size // factor}{unit}"
    return f"{size}B"


NO_SETTINGS: Final = ChannelSettings()
SETTING_NAMES: Final = ChannelSettings.__struct_fields__
_VIDEO_NAMES: Final = frozenset({"protocol", "compression"})
"""Settings that turn images into a video if either is set."""
LinkPattern = Annotated[str, msgspec.Meta(max_length=100)]


@register
class SetChannel(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Sets the channels of all own resources whose path matches (`sys/broker/set_channel`)."""

    pattern: str
    """Pattern of local paths: `nav/*`."""
    settings: ChannelSettings = NO_SETTINGS
    """Changed settings; without any, the rule for pattern and link is removed."""
    for_s: float = 0.0
    """Time after which the former settings apply again, or 0 for a change without an end."""
    link: LinkPattern = ""
    """Name or pattern of the receiving platforms; "" selects all."""
    unset: tuple[str, ...] = ()
    """Settings to be removed from the rule."""

    def __str__(self) -> str:
        """The change as the operator requested it."""
        span = f" --for {self.for_s:g}s" if self.for_s else ""
        unset = "".join(f" without {name}" for name in self.unset)
        return f"{_rule_text(self.pattern, self.link, self.settings)}{unset}{span}"


@register
class UndoChannel(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Undoes the last change by an operator that is still in force (`sys/broker/undo_channel`)."""


@register
class ClearChannels(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Removes rules that operators have set, but no rules of the file (`sys/broker/clear_channels`)."""

    pattern: str = ""
    """Pattern of the rules to remove; "" removes all."""


@register
class ChannelLimit(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A rule in force: settings of the channels that match."""

    pattern: str
    settings: ChannelSettings
    remaining_s: float | None = None
    """Time until the rule ends, or None if it has no end."""
    link: str = ""
    """Receiving platforms; "" selects all."""
    from_file: bool = False
    """Whether the rule comes from `channels.toml`."""

    def __str__(self) -> str:
        """The rule as an operator sets it."""
        return _rule_text(self.pattern, self.link, self.settings)

    def matches(self, path: str, link: str) -> bool:
        """Whether the rule applies to a resource sent to a platform; `link` is "" for beacons, which go to
        all."""
        return _pattern(self.pattern).matches(path) and self.is_to(link)

    def is_to(self, link: str) -> bool:
        """Whether the rule applies to values sent to a platform."""
        return not self.link or (bool(link) and _names(self.link).matches(link))


class RateSource(OpenEnum):
    """Origin of the rate at which values are sent, by precedence: the first that states one decides alone."""

    OPERATOR = "traffic set"
    """Rule of a channel by an operator; of several that match, the newest."""
    NOTIFICATION_RULE = "tree rule"
    """Minimum interval of the operator's notification rule."""
    FILE = "channels.toml"
    """First matching entry of the owner's file."""
    SUBSCRIBER = "tree.toml"
    """Minimum interval of the first matching entry in the subscriber's file."""
    RESOURCE = "rate_hz"
    """Rate that the application or the template states; notifications come at twice this rate at most."""
    DEFAULT = "min_interval_s"
    """Default interval of notified boards and settings, from the owner's `tree.toml`."""
    BEACON = "tick_hz"
    """Rate of the beacons, from the owner's `broker.toml`."""
    UNLIMITED = "none"
    """Each item of an event or a stream is sent."""


@register
class ChannelRate(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Maximum rate of a channel, and the place where it was set."""

    source: RateSource = RateSource.UNLIMITED
    max_hz: float | None = None
    """Maximum rate: 0 if nothing is sent, or None if every value is sent."""
    platform: str = ""
    """Platform on which it was set: the owner, or the subscriber."""
    pattern: str = ""
    """Pattern of the rule that decides; empty unless a rule decides."""
    link: str = ""
    """Receivers of that rule, or "" if it holds for all."""


@register
class ChannelRefusal(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A resource to which a change does not apply."""

    path: str
    reason: str


@register
class ChannelLimits(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All rules in force (board `net/limits`): the first that matches and has a setting decides it."""

    limits: tuple[ChannelLimit, ...] = ()
    """Rules of operators, the newest first, then the rules of the file in their order."""
    refused: tuple[ChannelRefusal, ...] = ()
    """Matching resources to which a change does not apply, in its reply."""


@register
class CompressionState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Result of the compression of one resource's values since the start."""

    path: str
    plain_bytes: int
    """Values before their compression, each once for all subscribers."""
    coded_bytes: int
    spent_s: float
    """Processor time."""
    refused: str = ""
    """Reason for which values were sent uncompressed, or "" if none were."""


@register
class ChannelState(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A resource on the way to one subscriber by notification, or to all subscribers in beacons."""

    path: str
    link: str
    """The subscriber; `*` for a board in beacons, of which `traffic top` shows the counters."""
    settings: ChannelSettings
    """Settings in force on this channel."""
    waiting: int
    """Items in the buffer."""
    waiting_bytes: int
    dropped: int
    """Items that the buffer dropped."""
    held_back: int
    """Items that the limit of the rate left out; values of a board that were replaced while the link had not
    acknowledged the one before."""
    rate_hz: float | None = None
    """Present limit of the rate, or None if nothing limits it."""
    reason: str = ""
    """Reason of the present limit: `set` by a rule, or the state of the link."""
    rate: ChannelRate = ChannelRate()
    """Rate in force, and the place where it was set."""


@register
class ListChannels(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/channels`."""

    all: bool = False
    """Also list channels that no rule concerns and no link limits, and boards in beacons."""


@register
class ChannelStates(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of the channels (`sys/tree/channels`)."""

    channels: tuple[ChannelState, ...] = ()
    compressions: tuple[CompressionState, ...] = ()


def settings_of(rules: Iterable[ChannelLimit], path: str, link: str = "") -> ChannelSettings:
    """The settings of a resource sent to a platform; `link` is "" for beacons, which go to all."""
    found: dict[str, object] = {}
    for rule in rules:
        if rule.matches(path, link):
            for name in SETTING_NAMES:
                value = getattr(rule.settings, name)
                if value is None or name == "adaptive":
                    continue
                if name == "max_hz" and name not in found and rule.settings.adaptive:
                    found["adaptive"] = True  # the rate of another rule is fixed: it must not follow the link
                found.setdefault(name, value)
    return msgspec.structs.replace(NO_SETTINGS, **found) if found else NO_SETTINGS


def rate_rule(rules: Iterable[ChannelLimit], path: str, link: str = "") -> ChannelLimit | None:
    """The first rule that sets the rate of a resource on the way to a platform, or None."""
    return next(
        (rule for rule in rules if rule.settings.max_hz is not None and rule.matches(path, link)), None
    )


def merged(settings: ChannelSettings, change: ChannelSettings, unset: Iterable[str] = ()) -> ChannelSettings:
    """Settings with a change; a change of the protocol or the compression of a video resets the other, too.

    Raises: InvalidInput for the name of a setting that does not exist.
    """
    fields = {name: value for name in SETTING_NAMES if (value := getattr(change, name)) is not None}
    if "max_hz" in fields or "max_hz" in unset:
        fields["adaptive"] = change.adaptive
    for name in unset:
        # A fixed rate ends the adaptive one, and the other way round: both are one setting for the
        # operator.
        if name not in SETTING_NAMES:
            raise InvalidInput(f"channel setting {name!r}: expected one of {', '.join(SETTING_NAMES)}")
        fields[name] = None
    given = _VIDEO_NAMES & fields.keys()
    if len(given) == 1 and change.is_video != settings.is_video:
        fields |= dict.fromkeys(_VIDEO_NAMES - given)
    return msgspec.structs.replace(settings, **fields)


# Half a video setting is invalid: rtp without h264, or h264 without rtp. The other half follows.


def _rule_text(pattern: str, link: str, settings: ChannelSettings) -> str:
    return " ".join(filter(None, (pattern, f"--link {link}" if link else "", str(settings))))


@lru_cache(maxsize=512)
def _pattern(text: str) -> Pattern:
    return Pattern(text)


@lru_cache(maxsize=128)
def _names(text: str) -> Pattern:
    return Pattern(text, of_computers=True)


def check_rule_names(pattern: str, link: str) -> None:
    """Check the patterns of a rule. Raises: InvalidInput for an invalid pattern of paths or of platforms."""
    _pattern(pattern)
    if link:
        _names(link)
