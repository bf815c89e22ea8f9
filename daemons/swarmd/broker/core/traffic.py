"""Traffic counters by link and channel, the channels of a frame, and counters of refused input."""

from collections.abc import Callable
from copy import copy
from typing import Final, Protocol

from swarmware.errors import WireError
from swarmware.model.compression import CONTAINER, items_in
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id
from swarmware.transport.delivery.answer import ANSWERS, answerable
from swarmware.transport.delivery.outcome import Status
from swarmware.types import registry
from swarmware.types.net import LinkTransport
from swarmware.types.rpc import Ack
from swarmware.types.traffic import ChannelTraffic, LinkTraffic, Refused
from swarmware.types.tree_exchange import TreeNotify

IP_UDP_BYTES: Final = 28
"""IPv4 and UDP headers of a datagram."""
NOTIFY_ID: Final = data_id("sys/tree/notify", TreeNotify.__name__)
NOTIFIES: Final = frozenset({FrameKind.NOTIFY, FrameKind.STREAM, FrameKind.EVENT, FrameKind.BOARD})
_BY_TREES: Final = NOTIFIES | {FrameKind.FILE}
"""Kinds of the notifications of trees; notifications with former values of boards are of kind FILE."""
_NAMES: Final = {kind: kind.name.lower() for kind in FrameKind}
_NAMED_BY_KIND: Final = frozenset({FrameKind.ACK, FrameKind.HELLO})
CHANNEL_LIMIT: Final = 4096
EVERYBODY: Final = "*"
"""Link of multicast datagrams."""
ASKED_MAX: Final = 4096
"""Questions whose answers are counted; more are not outstanding at a node that keeps up."""

_Question = tuple[int, int, int, int]
"""Asking application, receiver's hardware, data id and sequence."""


class ChannelCounters(ChannelTraffic, gc=False):
    """Counters of one board or kind of frame."""

    def offered(self, size: int) -> None:
        """Counts a value or frame offered for sending."""
        self.offered_frames += 1
        self.offered_bytes += size

    def repeated(self, size: int) -> None:
        """Counts a frame that its sender sends again."""
        self.repeated_frames += 1
        self.repeated_bytes += size

    def sent(self, size: int) -> None:
        """Counts a sent one."""
        self.sent_frames += 1
        self.sent_bytes += size

    def received(self, size: int) -> None:
        """Counts a received one."""
        self.received_frames += 1
        self.received_bytes += size


class Counters:
    """All counters of one broker, in mutable payload types, which the tables copy."""

    def __init__(self) -> None:
        self.links: dict[tuple[str, LinkTransport], LinkTraffic] = {}
        self.channels: dict[str, ChannelCounters] = {}
        self.refused = Refused()
        self.udp_sent_bytes = 0
        self.udp_received_bytes = 0
        self.serial_sent_bytes = 0
        self.serial_received_bytes = 0
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

    def link(self, platform: str, transport: LinkTransport) -> LinkTraffic:
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

    def datagram_sent(self, size: int, platform: str, transport: LinkTransport = LinkTransport.UDP) -> None:
        """Counts a sent datagram of `size` bytes; UDP without headers."""
        self.sent_datagrams += 1
        if transport is LinkTransport.UDP:
            size += IP_UDP_BYTES
            self.udp_sent_bytes += size
        else:
            self.serial_sent_bytes += size
        link = self.link(platform, transport)
        link.sent_frames += 1
        link.sent_bytes += size

    def datagram_received(
        self, size: int, platform: str, transport: LinkTransport = LinkTransport.UDP
    ) -> LinkTraffic:
        """Counts a received datagram of another node, valid or not; `size` as in `datagram_sent`."""
        self.received_datagrams += 1
        if transport is LinkTransport.UDP:
            size += IP_UDP_BYTES
            self.udp_received_bytes += size
        else:
            self.serial_received_bytes += size
        link = self.link(platform, transport)
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
    """Channels and payload bytes of a frame; a tree notification counts for the channel of each item."""
    size = len(frame.payload)
    if frame.data_id == NOTIFY_ID and frame.kind in _BY_TREES:
        try:
            note = registry.decode(TreeNotify, frame.payload, frame.codec)
        except WireError:
            note = None  # the receiver will refuse it
        if note is not None and note.items:
            parts = [(item.path, len(item.data)) for item in note.items]
            # the other items of a container have no bytes of their own
            for item in note.items:
                if item.codec == CONTAINER:
                    parts += [(item.path, 0)] * (items_in(item.data) - 1)
            return [*parts, ("sys/tree/notify", size - sum(part for _, part in parts))]
    if frame.kind in _NAMED_BY_KIND:
        return [(_NAMES[frame.kind], size)]
    return [(path_of(frame.data_id) or _NAMES[frame.kind], size)]


class ServedPaths(Protocol):
    """Paths of the addresses that applications of this node serve."""

    @property
    def version(self) -> int:
        """Number of changes so far."""
        ...

    def path_of(self, data_id: int) -> str | None:
        """The local path of an address with this data id."""
        ...


def _is_delivered(frame: Frame) -> bool:
    try:
        return registry.decode(Ack, frame.payload, frame.codec).status == Status.DELIVERED
    except WireError:
        return False  # the router drops it


class FrameAccounts:
    """Counters of the channels of frames.

    A frame is offered and sent, or received, in one step: its channels are determined once. The channels of
    a question are kept until its answer.
    """

    def __init__(self, counters: Counters, paths: ServedPaths) -> None:
        self._counters = counters
        self._paths = paths
        self._version = -1
        self._frame: Frame | None = None
        self._channels: list[tuple[ChannelCounters, int]] = []
        self._asked: dict[_Question, list[tuple[ChannelCounters, int]]] = {}

    def channels(self, frame: Frame) -> list[tuple[ChannelCounters, int]]:
        """Channels of a frame, and its payload bytes in each."""
        paths = self._paths
        if frame is not self._frame or paths.version != self._version:
            channel = self._counters.channel
            self._channels = [(channel(name), size) for name, size in shares(frame, paths.path_of)]
            self._frame, self._version = frame, paths.version
        return self._channels

    def offered(self, frame: Frame, *, first: bool) -> None:
        """Counts a frame of an application of this node; `first`: False for a retransmission."""
        channels = self.channels(frame)
        for channel, size in channels:
            if first:
                channel.offered(size)
            else:
                channel.repeated(size)
        if first and answerable(frame):
            if len(self._asked) >= ASKED_MAX:
                del self._asked[next(iter(self._asked))]
            self._asked[frame.sender_app, frame.receiver_hw, frame.data_id, frame.sequence] = channels

    def answered(self, frame: Frame) -> None:
        """Counts the question of an answer as delivered, unless the answer is a refusal."""
        if frame.kind not in ANSWERS:
            return
        channels = self._asked.pop((frame.receiver_app, frame.sender_hw, frame.data_id, frame.sequence), ())
        if frame.kind is FrameKind.ACK and not _is_delivered(frame):
            return
        for channel, _ in channels:
            channel.delivered_frames += 1

    def values(self, frame: Frame) -> int:
        """Number of notified values in a frame."""
        if frame.data_id == NOTIFY_ID and frame.kind in _BY_TREES:
            return len(self.channels(frame)) - 1
        return int(frame.kind in NOTIFIES)
