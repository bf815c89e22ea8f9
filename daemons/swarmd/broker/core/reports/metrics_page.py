"""The metrics of a broker as an OpenMetrics page, as Prometheus reads it.

Source: https://prometheus.io/docs/specs/om/open_metrics_spec/
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import Final

import msgspec

from swarmware.types.net import LinkStatus, Neighbours
from swarmware.types.outage import OutagePhase, OutageTable
from swarmware.types.traffic import Traffic

CONTENT_TYPE: Final = "application/openmetrics-text; version=1.0.0; charset=utf-8"
END: Final = "# EOF\n"

Labels = tuple[tuple[str, str], ...]


class MetricKind(StrEnum):
    """How a metric changes."""

    COUNTER = "counter"
    """A number that rises, and begins again with a start of the broker."""
    GAUGE = "gauge"


class MetricFamily(msgspec.Struct, frozen=True):
    """A metric with its samples."""

    name: str
    kind: MetricKind
    unit: str
    """The last part of its name, or "" for a number of things."""
    text: str
    """Explanation of the number."""
    samples: tuple[tuple[Labels, float], ...]


_LINK_COUNTERS: Final = (
    ("sent_frames", "", "Frames by TCP, or datagrams, that were sent"),
    ("sent_bytes", "bytes", "Bytes sent; UDP with IP headers, TCP of the frames alone"),
    ("received_frames", "", "Frames by TCP, or datagrams, that were received"),
    ("received_bytes", "bytes", "Bytes received; UDP with IP headers, TCP of the frames alone"),
    ("offered_frames", "", "Frames that were given to the link"),
    ("delivered_frames", "", "Frames that the neighbour acknowledged, in datagrams"),
    ("repeated_bytes", "bytes", "Bytes of frames that were sent again in datagrams"),
    ("lost", "", "Datagrams of the neighbour that did not arrive"),
    ("late", "", "Datagrams that a later one overtook"),
    ("duplicates", "", "Datagrams that arrived twice"),
    ("dropped", "", "Frames that were dropped: full queue, too old"),
)
_CHANNEL_COUNTERS: Final = (
    ("offered_frames", "", "Values and frames that were offered for sending"),
    ("offered_bytes", "bytes", "Payload bytes offered"),
    ("sent_frames", "", "Values and frames that were sent"),
    ("sent_bytes", "bytes", "Payload bytes sent"),
    ("repeated_frames", "", "Frames that their sender sent again"),
    ("delivered_frames", "", "Messages and requests whose receiver answered"),
    ("received_frames", "", "Values and frames that were received"),
    ("received_bytes", "bytes", "Payload bytes received"),
    ("held_back", "", "Values that a limit delayed until a newer one replaced them"),
    ("dropped", "", "Frames that were dropped: full queue, too old, denied"),
    ("late", "", "Values older than the newest one"),
    ("duplicates", "", "Values that arrived twice"),
)
_NODE_COUNTERS: Final = (
    ("udp_sent_bytes", "bytes", "Bytes sent by UDP, with IP headers"),
    ("udp_received_bytes", "bytes", "Bytes received by UDP, with IP headers"),
    ("tcp_sent_bytes", "bytes", "Bytes sent by TCP, with IP headers, acknowledgements and repetitions"),
    ("tcp_received_bytes", "bytes", "Bytes received by TCP, with IP headers and acknowledgements"),
    ("forwarded_frames", "", "Frames of other nodes that were forwarded"),
    ("requests", "", "Requests from here that other platforms answered"),
    ("notifications", "", "Values of other platforms that were received"),
    ("failed_ticks", "", "Beacons that could not be composed"),
    ("slowed_ticks", "", "Beacons that were delayed because the processor was overloaded"),
)


def metrics_page(node: str, traffic: Traffic, neighbours: Neighbours, outages: OutageTable) -> str:
    """The page of a node; every sample has its name as label `node`."""
    families = (
        *_node_families(traffic),
        *_link_families(traffic),
        *_channel_families(traffic),
        *_neighbour_families(neighbours),
        *_outage_families(outages),
    )
    lines = [line for family in families for line in _lines(family, node)]
    return "".join(f"{line}\n" for line in lines) + END


def _node_families(traffic: Traffic) -> list[MetricFamily]:
    refused = msgspec.structs.asdict(traffic.refused).items()
    return [
        *(
            MetricFamily(f"swarm_{name}", MetricKind.COUNTER, unit, text, (((), getattr(traffic, name)),))
            for name, unit, text in _NODE_COUNTERS
        ),
        MetricFamily(
            "swarm_refused",
            MetricKind.COUNTER,
            "",
            "Input from outside that was refused, by reason",
            tuple(((("reason", reason),), count) for reason, count in refused),
        ),
        MetricFamily(
            "swarm_beacon_rate_hertz", MetricKind.GAUGE, "hertz", "Rate of beacons", (((), traffic.tick_hz),)
        ),
        MetricFamily(
            "swarm_beacon_slowdown_ratio",
            MetricKind.GAUGE,
            "ratio",
            "Factor by which beacons are rarer because the processor is overloaded",
            (((), traffic.slowdown),),
        ),
    ]


def _link_families(traffic: Traffic) -> list[MetricFamily]:
    def labels(name: str, transport: str) -> Labels:
        return (("neighbour", name), ("transport", transport))

    def samples(field: str) -> tuple[tuple[Labels, float], ...]:
        return tuple((labels(one.platform, one.transport), getattr(one, field)) for one in traffic.links)

    return [
        *(
            MetricFamily(f"swarm_link_{name}", MetricKind.COUNTER, unit, text, samples(name))
            for name, unit, text in _LINK_COUNTERS
        ),
        MetricFamily(
            "swarm_link_waiting_frames",
            MetricKind.GAUGE,
            "",
            "Frames that wait now",
            samples("waiting_frames"),
        ),
        MetricFamily(
            "swarm_link_waiting_bytes",
            MetricKind.GAUGE,
            "bytes",
            "Bytes that wait now",
            samples("waiting_bytes"),
        ),
        MetricFamily(
            "swarm_link_capacity_bytes_per_second",
            MetricKind.GAUGE,
            "bytes_per_second",
            "What the link carried when it was the limit last",
            tuple(
                (labels(one.platform, one.transport), one.capacity_bytes_s)
                for one in traffic.links
                if one.capacity_bytes_s is not None
            ),
        ),
    ]


def _channel_families(traffic: Traffic) -> list[MetricFamily]:
    return [
        MetricFamily(
            f"swarm_channel_{name}",
            MetricKind.COUNTER,
            unit,
            text,
            tuple(((("channel", one.channel),), getattr(one, name)) for one in traffic.channels),
        )
        for name, unit, text in _CHANNEL_COUNTERS
    ]


def _neighbour_families(table: Neighbours) -> list[MetricFamily]:
    found = {one.name if one.platform else f"{one.hardware:08x}": one for one in table.neighbours}

    def gauge(name: str, unit: str, text: str, values: Iterable[tuple[str, float]]) -> MetricFamily:
        return MetricFamily(
            name, MetricKind.GAUGE, unit, text, tuple(((("neighbour", who),), one) for who, one in values)
        )

    up = {who: one for who, one in found.items() if one.state is LinkStatus.UP}
    return [
        gauge(
            "swarm_link_up",
            "",
            "Whether the link works in both directions",
            ((who, float(who in up)) for who in found),
        ),
        gauge(
            "swarm_link_loss_in_ratio",
            "ratio",
            "Share of its last datagrams that did not arrive here",
            ((who, one.loss_in_ratio) for who, one in up.items()),
        ),
        gauge(
            "swarm_link_loss_out_ratio",
            "ratio",
            "Share of our datagrams that did not arrive there",
            ((who, one.loss_out_ratio) for who, one in up.items()),
        ),
        gauge(
            "swarm_link_round_trip_seconds",
            "seconds",
            "Round trip of datagrams",
            ((who, one.rtt_ms / 1000) for who, one in up.items() if one.rtt_ms is not None),
        ),
        gauge(
            "swarm_link_silence_seconds",
            "seconds",
            "Time since its newest datagram",
            ((who, one.silent_s) for who, one in found.items()),
        ),
    ]


def _outage_families(table: OutageTable) -> list[MetricFamily]:
    """Gauges, not counters: the table keeps the newest ones alone."""
    counts: dict[str, int] = {}
    newest: dict[str, float] = {}
    for one in table.outages:
        counts[one.name] = counts.get(one.name, 0) + 1
        if one.phase is OutagePhase.OVER and one.down_for_s is not None:
            newest.setdefault(one.name, one.down_for_s)
    return [
        MetricFamily(
            "swarm_link_kept_outages",
            MetricKind.GAUGE,
            "",
            "Outages of the link that the node keeps",
            tuple(((("neighbour", name),), count) for name, count in counts.items()),
        ),
        MetricFamily(
            "swarm_link_last_outage_seconds",
            MetricKind.GAUGE,
            "seconds",
            "Length of the last outage that is over",
            tuple(((("neighbour", name),), down_s) for name, down_s in newest.items()),
        ),
    ]


def _lines(family: MetricFamily, node: str) -> list[str]:
    suffix = "_total" if family.kind is MetricKind.COUNTER else ""
    lines = [f"# TYPE {family.name} {family.kind}"]
    if family.unit:
        lines.append(f"# UNIT {family.name} {family.unit}")
    lines.append(f"# HELP {family.name} {_escaped(family.text)}.")
    for labels, value in family.samples:
        shown = ",".join(f'{name}="{_escaped(text)}"' for name, text in (("node", node), *labels))
        lines.append(f"{family.name}{suffix}{{{shown}}} {value}")
    return lines


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("\n", r"\n").replace('"', r"\"")
