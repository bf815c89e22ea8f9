"""The figures of an experiment: the fixed JSON document, and the table beside the paper's."""

from typing import Final

import msgspec

from swarmctl.output import Cell, Column
from swarmlab.host import HostInfo


class TrafficFigures(msgspec.Struct, frozen=True):
    """Bytes really on the wire, counted at the brokers' sockets while the mission ran."""

    global_kbps: float = 0.0
    """What all nodes sent, together."""
    egress_kbps: float = 0.0
    """What a node sent; mean."""
    ingress_kbps: float = 0.0
    """What a node received; mean. A multicast datagram counts at each receiver."""


class Percentiles(msgspec.Struct, frozen=True):
    """A distribution of latencies."""

    p50: float | None = None
    p99: float | None = None
    max: float | None = None


class Receipt(msgspec.Struct, frozen=True):
    """How long one platform's order took."""

    platform: str
    command_ms: float
    """From the instruction at the ground station."""
    order_ms: float
    """From the order's own departure."""


class MeanMax(msgspec.Struct, frozen=True):
    """A mean and a worst case."""

    mean: float | None = None
    max: float | None = None


class P95(msgspec.Struct, frozen=True):
    """What 95 of 100 stay below."""

    p95: float | None = None


class ExperimentReport(msgspec.Struct, frozen=True, kw_only=True):
    """report.json: these keys and no others."""

    schema_version: int = 2
    nodes: int
    ready_s: float
    """From the first start of a process until every node was ready and every tree known."""
    completed: bool
    """Every platform's mission ended well."""
    duration_s: float
    """From the command until the last platform's mission ended, true time."""
    traffic: TrafficFigures
    requests: int
    """Requests answered between nodes, all nodes together."""
    notifications: int
    """Values delivered to other nodes, by beacon or notification, all nodes together."""
    bytes_per_notification: float | None
    """All bytes received on the wire by all nodes ÷ notifications."""
    command_to_receipt_ms: Percentiles
    """From the instruction at the ground station until a platform's broker takes its order off the link:
    S0.82's quantity, with the check, the assignment of roles and the wait behind other orders in it. True
    time, over the platforms."""
    order_to_receipt_ms: Percentiles
    """From each order's own departure: the network's and the two brokers' part of it."""
    receipts: tuple[Receipt, ...] = ()
    """The distribution: every platform but the ground station, whose order crosses no link."""
    formation_error_m: MeanMax
    """Distance of followers from their slots while the formation was formed."""
    min_separation_m: float | None
    """Between the centres of any two vehicles."""
    collisions: int
    frames_lost: int
    """Frames that one node sent and a neighbour never received."""
    log_frames: int
    log_gaps: int
    """Entries that the loggers report as missing."""
    clock_error_us: P95
    """True against estimated conversion, over all pairs of nodes while the mission ran."""
    cpu_percent_of_core: MeanMax
    """Of a node, over the mission."""
    rss_mb: MeanMax
    """Of a node."""
    host: HostInfo = HostInfo()


class ReportLimits(msgspec.Struct, frozen=True):
    """Goals of the experiment on two cores."""

    ready_s: float = 15.0
    formation_error_m: float = 1.0
    receipt_p50_ms: float = 6.0
    receipt_p99_ms: float = 11.95
    """The paper's own figure."""
    bytes_per_notification: float = 200.0


LIMITS: Final = ReportLimits()

_DIGITS: Final = 4


def rounded(report: ExperimentReport) -> dict[str, object]:
    """The document with four significant digits: more would be noise."""

    def trim(value: object) -> object:
        if isinstance(value, float):
            return float(f"{value:.{_DIGITS}g}")
        if isinstance(value, dict):
            return {key: trim(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [trim(inner) for inner in value]
        return value

    return {key: trim(value) for key, value in msgspec.to_builtins(report).items()}


class ComparisonRow(msgspec.Struct, frozen=True):
    """One line of the table."""

    what: str
    paper: str
    """Figure of the paper; empty where it has none."""
    ours: str
    note: str = ""


def comparison(report: ExperimentReport) -> list[ComparisonRow]:
    """Paper S0's figures beside ours, then what it did not report."""
    receipt, error = report.command_to_receipt_ms, report.formation_error_m
    order = report.order_to_receipt_ms
    return [
        ComparisonRow("nodes", "16", str(report.nodes), "vehicles and the ground station"),
        ComparisonRow(
            "global traffic", "56.07 kB/s", f"{report.traffic.global_kbps:.2f} kB/s", "all nodes' egress"
        ),
        ComparisonRow("egress traffic", "14.89 kB/s", f"{report.traffic.egress_kbps:.2f} kB/s", "per node"),
        ComparisonRow(
            "ingress traffic",
            "1.31 kB/s",
            f"{report.traffic.ingress_kbps:.2f} kB/s",
            "per node, heard from all",
        ),
        ComparisonRow("request/response", "25", _count(report.requests), "between nodes"),
        ComparisonRow("notifications", "81 297", _count(report.notifications), "delivered to other nodes"),
        ComparisonRow("command to receipt", "11.95 ms", _number(receipt.p50, "ms"), _tail(receipt)),
        ComparisonRow("order to receipt", "", _number(order.p50, "ms"), _tail(order)),
        ComparisonRow(
            "bytes per notification",
            "",
            _number(report.bytes_per_notification, "B"),
            "everything on the wire",
        ),
        ComparisonRow(
            "mission", "", f"{'completed' if report.completed else 'FAILED'}", f"{report.duration_s:.1f} s"
        ),
        ComparisonRow("ready", "", f"{report.ready_s:.1f} s", "all nodes up, all trees known"),
        ComparisonRow(
            "formation error", "", _number(error.mean, "m"), f"max {_number(error.max, 'm')}, once formed"
        ),
        ComparisonRow("least separation", "", _number(report.min_separation_m, "m"), "centre to centre"),
        ComparisonRow("collisions", "", str(report.collisions)),
        ComparisonRow("frames lost", "", _count(report.frames_lost), "between nodes"),
        ComparisonRow("log entries", "", _count(report.log_frames), f"{_count(report.log_gaps)} missing"),
        ComparisonRow("clock error", "", _number(report.clock_error_us.p95, "µs"), "p95 of all pairs"),
        ComparisonRow(
            "CPU per node",
            "",
            _number(report.cpu_percent_of_core.mean, "%"),
            f"of a core, max {_number(report.cpu_percent_of_core.max, '%')}",
        ),
        ComparisonRow(
            "memory per node",
            "",
            _number(report.rss_mb.mean, "MB"),
            f"max {_number(report.rss_mb.max, 'MB')}",
        ),
    ]


def markdown(report: ExperimentReport) -> str:
    """The comparison as a table for a page."""
    lines = ["| | paper | here | |", "|---|---|---|---|"]
    lines += [f"| {row.what} | {row.paper or '–'} | {row.ours} | {row.note} |" for row in comparison(report)]
    return "\n".join(lines) + "\n"


COLUMNS: Final = (Column(""), Column("paper", right=True), Column("here", right=True), Column(""))


def cells(report: ExperimentReport) -> list[list[Cell]]:
    """The comparison for `Output.table`."""
    return [[row.what, row.paper, row.ours, row.note] for row in comparison(report)]


def shortfalls(report: ExperimentReport) -> list[str]:
    """Reasons why the experiment failed, each as a sentence; none when it passed."""
    found = []
    if not report.completed:
        found.append("the mission was not completed")
    if report.collisions:
        found.append(f"{report.collisions} collision{'s' if report.collisions > 1 else ''}")
    return found


def misses(report: ExperimentReport, limits: ReportLimits = LIMITS) -> list[str]:
    """Goals not reached, each with the goal; they fail the experiment only where asked (`--strict`)."""
    wanted = (
        ("ready", report.ready_s, limits.ready_s, "s"),
        ("mean formation error", report.formation_error_m.mean, limits.formation_error_m, "m"),
        ("command to receipt, p50", report.command_to_receipt_ms.p50, limits.receipt_p50_ms, "ms"),
        ("command to receipt, p99", report.command_to_receipt_ms.p99, limits.receipt_p99_ms, "ms"),
        ("bytes per notification", report.bytes_per_notification, limits.bytes_per_notification, "B"),
    )
    return [
        f"{name}: {_number(value, unit)}, goal below {limit:g} {unit}"
        for name, value, limit, unit in wanted
        if value is None or value >= limit
    ]


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.3g} {unit}" if abs(value) < 1000 else f"{value:.0f} {unit}"


def _count(value: int) -> str:
    return f"{value:,}".replace(",", " ")


def _tail(values: Percentiles) -> str:
    return f"p99 {_number(values.p99, 'ms')}, max {_number(values.max, 'ms')}"
