"""Rates of the channels and links of a broker, between two readings of its counters."""

from typing import Final

import msgspec

from swarmctl.commands.traffic.limited import LimitedChannel
from swarmware.types.traffic import ChannelTraffic, LinkTraffic, Traffic


class ChannelRates(msgspec.Struct, frozen=True):
    """Rates of one channel."""

    channel: str
    offered_hz: float
    sent_hz: float
    sent_bytes_s: float
    received_hz: float
    received_bytes_s: float
    dropped_hz: float
    held_back_hz: float
    repeated_hz: float
    repeated_bytes_s: float
    delivered_hz: float
    """Rate of frames whose receiver answered; boards have no answer."""


class LinkRates(msgspec.Struct, frozen=True):
    """Rates of one link."""

    platform: str
    transport: str
    offered_hz: float
    sent_hz: float
    """Rate of frames; for udp of datagrams, including beacons."""
    sent_bytes_s: float
    received_hz: float
    received_bytes_s: float
    repeated_bytes_s: float
    dropped_hz: float
    delivered_hz: float
    """Rate of frames in datagrams that the neighbour acknowledged."""
    lost_hz: float
    """Rate of the neighbour's datagrams that did not arrive."""
    waiting_frames: int
    """Frames in the queue at the end of the period."""
    waiting_bytes: int


class TrafficRates(msgspec.Struct, frozen=True):
    """Rates of a platform's channels and links in one period."""

    platform: str
    at_ns: int
    sent_bytes_s: float
    """Bytes on the wire per second, over all channels."""
    received_bytes_s: float
    channels: list[ChannelRates]
    links: list[LinkRates]
    limited: list[LimitedChannel] = []


def rates(platform: str, before: Traffic, now: Traffic) -> TrafficRates:
    """Rates between two readings of the counters, in their order, without channels and links at rest.

    After a restart of the broker in between, the rates begin at the restart, which reset the counters.
    """
    # without this the counters of the new process would give negative rates
    if now.since_ns != before.since_ns:
        before = msgspec.structs.replace(
            before, at_ns=now.since_ns, sent_bytes=0, received_bytes=0, channels=(), links=()
        )
    span_s = (now.at_ns - before.at_ns) / 1e9
    channels = {one.channel: one for one in before.channels}
    links = {(one.platform, one.transport): one for one in before.links}
    moved = [(one, _deltas(one, channels.get(one.channel), _CHANNEL_FIELDS, span_s)) for one in now.channels]
    carried = [
        (one, _deltas(one, links.get((one.platform, one.transport)), _LINK_FIELDS, span_s))
        for one in now.links
    ]
    return TrafficRates(
        platform,
        now.at_ns,
        (now.sent_bytes - before.sent_bytes) / span_s,
        (now.received_bytes - before.received_bytes) / span_s,
        [ChannelRates(one.channel, **deltas) for one, deltas in moved if any(deltas.values())],
        [
            LinkRates(
                one.platform,
                one.transport,
                **deltas,
                waiting_frames=one.waiting_frames,
                waiting_bytes=one.waiting_bytes,
            )
            for one, deltas in carried
            # a link that sends nothing but has a queue is what an operator looks for
            if any(deltas.values()) or one.waiting_frames
        ],
    )


_CHANNEL_FIELDS: Final = {
    "offered_hz": "offered_frames",
    "sent_hz": "sent_frames",
    "sent_bytes_s": "sent_bytes",
    "received_hz": "received_frames",
    "received_bytes_s": "received_bytes",
    "dropped_hz": "dropped",
    "held_back_hz": "held_back",
    "repeated_hz": "repeated_frames",
    "repeated_bytes_s": "repeated_bytes",
    "delivered_hz": "delivered_frames",
}
"""Counter from which each rate of a channel derives."""
_LINK_FIELDS: Final = {
    "offered_hz": "offered_frames",
    "sent_hz": "sent_frames",
    "sent_bytes_s": "sent_bytes",
    "received_hz": "received_frames",
    "received_bytes_s": "received_bytes",
    "repeated_bytes_s": "repeated_bytes",
    "dropped_hz": "dropped",
    "delivered_hz": "delivered_frames",
    "lost_hz": "lost",
}
"""Counter from which each rate of a link derives."""


def _deltas(
    now: ChannelTraffic | LinkTraffic,
    before: ChannelTraffic | LinkTraffic | None,
    fields: dict[str, str],
    span_s: float,
) -> dict[str, float]:
    return {
        rate: (getattr(now, counter) - (getattr(before, counter) if before else 0)) / span_s
        for rate, counter in fields.items()
    }
