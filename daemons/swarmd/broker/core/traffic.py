"""Traffic counters by link and channel, and counters of refused input."""

from typing import Final

import msgspec

from swarmware.types.net import ChannelTraffic, LinkTraffic, Refused

IP_UDP_BYTES: Final = 28
"""IPv4 and UDP headers of a datagram."""
CHANNEL_LIMIT: Final = 4096
EVERYBODY: Final = "*"
"""Link of multicast datagrams."""


class LinkCounters(msgspec.Struct, gc=False):
    """Counters of one neighbour and transport."""

    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    lost: int = 0
    late: int = 0
    duplicates: int = 0
    dropped: int = 0


class ChannelCounters(msgspec.Struct, gc=False):
    """Counters of one board or kind of frame."""

    offered_frames: int = 0
    offered_bytes: int = 0
    sent_frames: int = 0
    sent_bytes: int = 0
    received_frames: int = 0
    received_bytes: int = 0
    dropped: int = 0
    late: int = 0
    duplicates: int = 0
    max_hz: float | None = None
    held_back: int = 0

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


class Refusals(msgspec.Struct, gc=False):
    """Counters of refused input; the fields are those of `Refused`."""

    forged: int = 0
    replayed: int = 0
    old_session: int = 0
    unknown_session: int = 0
    other_epoch: int = 0
    malformed: int = 0
    spoofed: int = 0
    denied_connections: int = 0
    looped: int = 0
    no_route: int = 0
    hop_limit: int = 0
    unheard: int = 0
    expired: int = 0
    no_room: int = 0
    failed: int = 0
    denied: int = 0
    unproven: int = 0
    flooded: int = 0


class Counters:
    """All counters of one broker."""

    def __init__(self) -> None:
        self.links: dict[tuple[str, str], LinkCounters] = {}
        self.channels: dict[str, ChannelCounters] = {}
        self.refused = Refusals()
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

    def link(self, platform: str, transport: str) -> LinkCounters:
        """Counters of a link."""
        link = self.links.get((platform, transport))
        if link is None:
            link = self.links[platform, transport] = LinkCounters()
        return link

    def channel(self, name: str) -> ChannelCounters:
        """Counters of a channel; beyond the limit all share one."""
        channel = self.channels.get(name)
        if channel is None:
            if len(self.channels) >= CHANNEL_LIMIT:
                name = "other"
            channel = self.channels.setdefault(name, ChannelCounters())
        return channel

    def datagram_sent(self, size: int, platform: str) -> None:
        """Counts a sent datagram of `size` bytes without headers."""
        size += IP_UDP_BYTES
        self.sent_datagrams += 1
        self.udp_sent_bytes += size
        link = self.link(platform, "udp")
        link.sent_frames += 1
        link.sent_bytes += size

    def datagram_received(self, size: int, platform: str) -> LinkCounters:
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
        return tuple(
            LinkTraffic(platform, transport, *msgspec.structs.astuple(link))
            for (platform, transport), link in self.links.items()
        )

    def channel_table(self) -> tuple[ChannelTraffic, ...]:
        """Counters of all channels."""
        return tuple(
            ChannelTraffic(name, *msgspec.structs.astuple(channel)) for name, channel in self.channels.items()
        )

    def refused_table(self) -> Refused:
        """Counters of refused input."""
        return Refused(*msgspec.structs.astuple(self.refused))
