"""Video that the rules of channels ask for: which sources go to which platforms."""

from collections.abc import Collection, Iterable
from typing import Final

import msgspec

from swarmware.types.channel import ChannelLimit, settings_of

RETRY_NS: Final = 5_000_000_000
"""Pause after a start that failed."""


class Channel(msgspec.Struct, frozen=True):
    """A source on the way to a platform."""

    source: str
    platform: str


class StartVideo(msgspec.Struct, frozen=True):
    """Action: send this source there, with at most this number of pictures a second; None: all."""

    channel: Channel
    max_hz: float | None


class StopVideo(msgspec.Struct, frozen=True):
    """Action: no rule asks for this video any longer."""

    channel: Channel


class ChannelVideo:
    """Follows the rules; a session that ends while its rule holds is started again."""

    def __init__(self) -> None:
        self._started: dict[Channel, float | None] = {}
        """Those that run because of a rule, with their rate."""
        self._retry_ns: dict[Channel, int] = {}
        """When the next start may be tried, after one that failed."""

    @property
    def is_busy(self) -> bool:
        """Whether a rule has started a session."""
        return bool(self._started)

    def changes(
        self,
        rules: Iterable[ChannelLimit],
        sources: Collection[str],
        platforms: Collection[str],
        sent: Collection[Channel],
        now_ns: int,
    ) -> list[StartVideo | StopVideo]:
        """What to do so that the rules hold; `platforms`: those in reach, `sent`: what is sent at present."""
        known = tuple(rules)
        wanted = {
            Channel(source, platform): settings.max_hz
            for source in sources
            for platform in platforms
            if (settings := settings_of(known, source, platform)).is_video and settings.max_hz != 0
        }
        running = {channel: rate for channel, rate in self._started.items() if channel in sent}
        over = [one for one, rate in running.items() if one not in wanted or wanted[one] != rate]
        self._retry_ns = {one: due_ns for one, due_ns in self._retry_ns.items() if one in wanted}
        begin = [
            one
            for one in wanted
            # one that an operator has started stays as it is
            if (one in over or one not in sent) and self._retry_ns.get(one, now_ns) <= now_ns
        ]
        self._started = {one: rate for one, rate in running.items() if one not in over}
        self._started |= {one: wanted[one] for one in begin}
        return [*map(StopVideo, over), *(StartVideo(one, wanted[one]) for one in begin)]

    def on_failed(self, channel: Channel, now_ns: int) -> None:
        """A start has failed: it is tried again later."""
        self._started.pop(channel, None)
        self._retry_ns[channel] = now_ns + RETRY_NS
