"""Video by rules of channels, which state the sources that are sent to each platform."""

from collections.abc import Collection, Iterable
from typing import Final

import msgspec

from swarmware.types.channel import ChannelLimit, settings_of

RETRY_NS: Final = 5_000_000_000
"""Pause after a failed start."""


class Channel(msgspec.Struct, frozen=True):
    """A source, and the platform to which it is sent."""

    source: str
    platform: str


class StartVideo(msgspec.Struct, frozen=True):
    """Action: send a source to a platform, with at most `max_hz` pictures a second, or all if None."""

    channel: Channel
    max_hz: float | None


class StopVideo(msgspec.Struct, frozen=True):
    """Action: end a session that no rule asks for any longer."""

    channel: Channel


class ChannelVideo:
    """Follows the rules, and restarts a session that ends while its rule holds."""

    def __init__(self) -> None:
        self._started: dict[Channel, float | None] = {}
        """Channels whose session a rule has started, with their maximum rate."""
        self._retry_ns: dict[Channel, int] = {}
        """Instant of the next attempt by channel, after a failed start."""

    @property
    def is_busy(self) -> bool:
        """True if a rule has started a session that still runs."""
        return bool(self._started)

    def changes(
        self,
        rules: Iterable[ChannelLimit],
        sources: Collection[str],
        platforms: Collection[str],
        sent: Collection[Channel],
        now_ns: int,
    ) -> list[StartVideo | StopVideo]:
        """Actions that make the rules hold; `platforms` are in reach, `sent` are the present sessions."""
        known = tuple(rules)
        wanted = {
            Channel(source, platform): settings.max_hz
            for source in sources
            for platform in platforms
            if (settings := settings_of(known, source, platform)).is_video and settings.max_hz != 0
        }
        # sessions that ended by themselves are started again below
        running = {channel: rate for channel, rate in self._started.items() if channel in sent}
        over = [one for one, rate in running.items() if one not in wanted or wanted[one] != rate]
        self._retry_ns = {one: due_ns for one, due_ns in self._retry_ns.items() if one in wanted}
        begin = [
            one
            for one in wanted
            # a session that an operator has started stays unchanged
            if (one in over or one not in sent) and self._retry_ns.get(one, now_ns) <= now_ns
        ]
        self._started = {one: rate for one, rate in running.items() if one not in over}
        self._started |= {one: wanted[one] for one in begin}
        return [*map(StopVideo, over), *(StartVideo(one, wanted[one]) for one in begin)]

    def on_failed(self, channel: Channel, now_ns: int) -> None:
        """Takes a failed start, which is tried again later."""
        self._started.pop(channel, None)
        self._retry_ns[channel] = now_ns + RETRY_NS
