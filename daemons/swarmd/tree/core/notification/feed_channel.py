"""How the values of one feed travel: its rate, its buffer, its compression, its priority."""

from typing import Final, Self

import msgspec

from swarmware.model.compression import AUTO, Compression, Method
from swarmware.types.channel import RATE_MAX_HZ, ChannelPriority, ChannelSettings

QUEUE_LIMIT: Final = 4096
"""Maximum number of waiting items: minutes without a link, not hours."""
QUEUE_BYTES: Final = 1024 * 1024
"""Maximum bytes of values in them; one item is always kept."""
ITEM_BYTES: Final = 64
"""Smallest item for which a buffer of a set size has room: it bounds the number of items."""
CATCH_UP: Final = 2
"""Rate at which a limited channel sends what waits, by the rate of its limit."""
BURST_NS: Final = 20_000_000
"""Items of this time may be sent together by a channel of a high rate."""
_PRIORITIES: Final = {ChannelPriority.HIGH: 1, ChannelPriority.LOW: -1}


class FeedChannel(msgspec.Struct, frozen=True):
    """Settings in force of one feed."""

    limit_ns: int | None = 0
    """Minimum interval of its values, or None if nothing is sent."""
    buffer_bytes: int = QUEUE_BYTES
    buffer_items: int = QUEUE_LIMIT
    buffer_ns: int | None = None
    """Maximum age of waiting items, or None if unlimited."""
    compression: Compression = Compression()
    priority: int = 0
    """Priority; feeds with a higher number are served first."""
    is_adaptive: bool = False
    """Whether the rate of a stream follows its link."""
    is_rate_set: bool = False
    """True if a rule of channels sets the rate, which then takes the place of all other intervals."""
    is_buffered: bool = False
    """Whether a buffer is set: then a board keeps the values that it could not send."""

    @property
    def catch_up_ns(self) -> int | None:
        """Minimum interval of waiting items; shorter than for new ones, or the queue would never end."""
        return self.limit_ns and self.limit_ns // CATCH_UP

    @classmethod
    def of(cls, settings: ChannelSettings, *, may_be_video: bool = False) -> Self:
        """The settings with defaults where nothing is set; values that travel as video are not notified."""
        max_hz, size = settings.max_hz, settings.buffer_bytes
        is_rate_set = max_hz is not None
        if settings.is_video:
            max_hz = 0.0 if may_be_video else max_hz
            # a coded image is compressed already
            settings = msgspec.structs.replace(settings, compression=str(Method.NONE))
        compression = Compression.parse(settings.compression or "none")
        return cls(
            0 if max_hz is None or max_hz >= RATE_MAX_HZ else None if max_hz <= 0 else round(1e9 / max_hz),
            QUEUE_BYTES if size is None else size,
            QUEUE_LIMIT if size is None else max(QUEUE_LIMIT, size // ITEM_BYTES),
            None if settings.buffer_s is None else round(settings.buffer_s * 1e9),
            AUTO if compression.method is Method.AUTO else compression,
            0 if settings.priority is None else _PRIORITIES.get(settings.priority, 0),
            bool(settings.adaptive) and not settings.is_video,
            is_rate_set,
            size is not None or settings.buffer_s is not None,
        )
