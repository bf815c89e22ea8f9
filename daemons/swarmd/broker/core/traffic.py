"""Traffic counters by link and channel, the channels of a frame, and counters of refused input."""

from collections.abc import Callable
from copy import copy
from typing import Final

from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id
from swarmware.types import registry
from swarmware.types.net import ChannelTraffic, LinkTraffic, Refused
from swarmware.types.tree import TreeNotify

IP_UDP_BYTES: Final = 28
"""IPv4 and UDP headers of a datagram."""
NOTIFY_ID: Final = data_id("sys/tree/notify", TreeNotify.__name__)
NOTIFIES: Final = frozenset({FrameKind.NOTIFY, FrameKind.STREAM, FrameKind.EVENT})
CHANNEL_LIMIT: Final = 4096
EVERYBODY: Final = "*"
"""Link of multicast datagrams."""


class ChannelCounters(ChannelTraffic, gc=False):
    """Counters of one board or kind of frame."""

    def offered(self, size: int) -> None:
        """Counts a value or frame offered for sending."""
        self.offered_frames += 1
        self.offered_bytes += size

    def sent(self, size: int) -> None:
        """Counts a sent one."""
        self.sent_frames += 1
        self.sent_bytes += size

    def received(self, size: int) -> None:
        """Counts a received one."""
        self.received_frames += 1
        self.received_bytes += size


class Counters:
    """All counters of one broker. The payload types are counted in; the tables are copies of them."""

    def __init__(self) -> None:
        self.links: dict[tuple[str, str], LinkTraffic] = {}
        self.channels: dict[str, ChannelCounters] = {}
        self.refused = Refused()
        self.udp_sent_bytes = 0
        self.udp_received_bytes = 0
        self.tcp_sent_bytes = 0
        self.tcp_received_bytes = 0
        self.sent_datagrams = 0
        self.received_datagrams = 0
        self.sent_frames = 0
        self.received_frames = 0
        self.forwarded_frames = 0
        self.requests = 0
        self.notifications = 0
        self.failed_ticks = 0

    def link(self, platform: str, transport: str) -> LinkTraffic:
        """Counters of a link."""
        link = self.links.get((platform, transport))
        if link is None:
            link = self.links[platform, transport] = LinkTraffic(platform, transport)
        return link

    def channel(self, name: str) -> ChannelCounters:
        """Counters of a channel; beyond the limit all share one."""
        channel = self.channels.get(name)
        if channel is None:
            if len(self.channels) >= CHANNEL_LIMIT:
                name = "other"
            channel = self.channels.setdefault(name, ChannelCounters(name))
        return channel

    def datagram_sent(self, size: int, platform: str) -> None:
        """Counts a sent datagram of `size` bytes without headers."""
        size += IP_UDP_BYTES
        self.sent_datagrams += 1
        self.udp_sent_bytes += size
        link = self.link(platform, "udp")
        link.sent_frames += 1
        link.sent_bytes += size

    def datagram_received(self, size: int, platform: str) -> LinkTraffic:
        """Counts a received datagram of another node, valid or not."""
        size += IP_UDP_BYTES
        self.received_datagrams += 1
        self.udp_received_bytes += size
        link = self.link(platform, "udp")
        link.received_frames += 1
        link.received_bytes += size
        return link

    def link_table(self) -> tuple[LinkTraffic, ...]:
        """Counters of all links."""
        return tuple(map(copy, self.links.values()))

    def channel_table(self) -> tuple[ChannelTraffic, ...]:
        """Counters of all channels."""
        return tuple(map(copy, self.channels.values()))

    def refused_table(self) -> Refused:
        """Counters of refused input."""
        return copy(self.refused)


def shares(frame: Frame, path_of: Callable[[int], str | None]) -> list[tuple[str, int]]:
    """Channels and payload bytes of a frame; those of a tree notification are counted by item."""
    size = len(frame.payload)
    if frame.data_id == NOTIFY_ID and frame.kind in NOTIFIES:
        try:
            note = registry.decode(TreeNotify, frame.payload, frame.codec)
        except WireError:
            note = None  # the receiver will refuse it
        if note is not None and note.items:
            parts = [(item.path, len(item.data)) for item in note.items]
            return [*parts, ("sys/tree/notify", size - sum(part for _, part in parts))]
    if frame.kind in {FrameKind.ACK, FrameKind.HELLO}:
        return [(frame.kind.name.lower(), size)]
    return [(path_of(frame.data_id) or frame.kind.name.lower(), size)]


def values_in(frame: Frame) -> int:
    """Number of notified values in a frame."""
    if frame.kind not in NOTIFIES:
        return 0
    if frame.data_id != NOTIFY_ID:
        return 1
    try:
        return len(registry.decode(TreeNotify, frame.payload, frame.codec).items)
    except WireError:
        return 0
