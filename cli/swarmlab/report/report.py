"""The figures of an experiment: the fixed JSON document, and the table beside the paper's."""

from typing import Final

import msgspec

from swarmctl.terminal.table import Column
from swarmlab.measure.host import HostInfo


class TrafficFigures(msgspec.Struct, frozen=True):
    """Bytes on the wire, counted at the brokers' sockets during the mission."""

    global_kbps: float = 0.0
    """Total sent by all nodes."""
    egress_kbps: float = 0.0
    """Mean sent per node."""
    ingress_kbps: float = 0.0
    """Mean received per node; a multicast datagram counts at each receiver."""


class Percentiles(msgspec.Struct, frozen=True):
    """A distribution of latencies."""

    p50: float | None = None
    p99: float | None = None
    max: float | None = None


class Receipt(msgspec.Struct, frozen=True):
    """Delays of one platform's order."""

    platform: str
    command_ms: float
    """Delay from the instruction at the ground station."""
    order_ms: float
    """Delay from the sending of the order."""


class MeanMax(msgspec.Struct, frozen=True):
    """Mean and maximum of a quantity."""

    mean: float | None = None
    max: float | None = None


class P95(msgspec.Struct, frozen=True):
    """The 95th percentile of a quantity."""

    p95: float | None = None


class ExperimentReport(msgspec.Struct, frozen=True, kw_only=True):
    """report.json: these keys and no others."""

    schema_version: int = 2
    nodes: int
    ready_s: float
    """Time from the first start of a process until all nodes were ready and all trees known."""
    completed: bool
    """Whether the mission was successful on all platforms."""
    duration_s: float
    """True time from the command until the last platform's mission ended."""
    traffic: TrafficFigures
    requests: int
    """Requests answered between nodes, all nodes together."""
    notifications: int
    """Values delivered to other nodes, by beacon or notification, all nodes together."""
    bytes_per_notification: float | None
    """All bytes received on the wire by all nodes ÷ notifications."""
    command_to_receipt_ms: Percentiles
    """Delay from the instruction at the ground station until a platform's broker receives its order:
    S0.82's quantity, including the check, the assignment of roles and the wait for other orders. True
    time, over the platforms."""
    order_to_receipt_ms: Percentiles
    """Delay from the sending of each order: the part of the network and the two brokers."""
    receipts: tuple[Receipt, ...] = ()
    """Delays of all platforms except the ground station, whose order crosses no link."""
    formation_error_m: MeanMax
    """Distance of followers from their slots while the formation was formed."""
    min_separation_m: float | None
    """Minimum distance between the centres of two vehicles."""
    collisions: int
    frames_lost: int
    """Frames that a node sent and a neighbour did not receive."""
    log_frames: int
    log_gaps: int
    """Entries that the loggers report as missing."""
    clock_error_us: P95
    """Error of the clock conversions over all pairs of nodes during the mission."""
    cpu_percent_of_core: MeanMax
    """Processor time per node over the mission, in percent of one core."""
    rss_mb: MeanMax
    """Resident memory per node (RSS): pages that its processes or nodes share count in each."""
    host: HostInfo
    pss_mb: MeanMax
    """`rss_mb` with shared pages divided among those who share them (PSS)."""
    last_answer_ms: float | None = None
    """Delay from the instruction until the ground station had the last answer to an order, or None if one was
    not answered."""


class PaperFigures(msgspec.Struct, frozen=True):
    """What paper S0 reports of its experiment."""

    nodes: int = 16
    global_kbps: float = 56.07
    egress_kbps: float = 14.89
    """Per node."""
    ingress_kbps: float = 1.31
    """Per node."""
    receipt_ms: float = 11.95


PAPER: Final = PaperFigures()


def comparable(report: ExperimentReport) -> bool:
    """Whether the run has as many nodes as the paper's: traffic and delays depend on their number."""
    return report.nodes == PAPER.nodes


def comparison_note(report: ExperimentReport) -> str:
    """Why the paper's figures are not shown, or "" if they are."""
    if comparable(report):
        return ""
    return (
        f"the paper's figures are of {PAPER.nodes} nodes and are left out: "
        f"this run has {report.nodes}, and traffic and delays depend on their number"
    )


class ReportLimits(msgspec.Struct, frozen=True):
    """Goals of the experiment on two cores."""

    ready_s: float = 15.0
    formation_error_m: float = 1.0
    receipt_p50_ms: float = 8.0
    receipt_p99_ms: float = PAPER.receipt_ms
    """The paper's own figure."""
    last_answer_ms: float = 20.0
    bytes_per_notification: float = 200.0


LIMITS: Final = ReportLimits()

_DIGITS: Final = 4


def rounded(report: ExperimentReport) -> dict[str, object]:
    """The document with numbers of four significant digits."""

    def trim(value: object) -> object:
        if isinstance(value, float):
            # further digits are noise of the run, and would differ in every comparison
            return float(f"{value:.{_DIGITS}g}")
        if isinstance(value, dict):
            return {key: trim(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [trim(inner) for inner in value]
        return value

    return {key: trim(value) for key, value in msgspec.to_builtins(report).items()}


class ComparisonRow(msgspec.Struct, frozen=True):
    """One row of the comparison."""

    what: str
    paper: str
    """Figure of the paper, or "" if it has none."""
    ours: str
    note: str = ""


def comparison(report: ExperimentReport) -> list[ComparisonRow]:
    """Figures of paper S0 beside the figures of a run with as many nodes, then figures that S0 lacks."""
    rows = _rows(report)
    return rows if comparable(report) else [msgspec.structs.replace(row, paper="") for row in rows]


def _rows(report: ExperimentReport) -> list[ComparisonRow]:
    receipt, error = report.command_to_receipt_ms, report.formation_error_m
    order = report.order_to_receipt_ms
    return [
        ComparisonRow("nodes", str(PAPER.nodes), str(report.nodes), "vehicles and the ground station"),
        ComparisonRow(
            "global traffic",
            f"{PAPER.global_kbps} kB/s",
            f"{report.traffic.global_kbps:.2f} kB/s",
            "all nodes' egress",
        ),
        ComparisonRow(
            "egress traffic",
            f"{PAPER.egress_kbps} kB/s",
            f"{report.traffic.egress_kbps:.2f} kB/s",
            "per node",
        ),
        ComparisonRow(
            "ingress traffic",
            f"{PAPER.ingress_kbps} kB/s",
            f"{report.traffic.ingress_kbps:.2f} kB/s",
            f"per node; the beacons of all {report.nodes - 1} others reach each node by multicast",
        ),
        ComparisonRow("request/response", "25", _count(report.requests), "between nodes"),
        ComparisonRow("notifications", "81 297", _count(report.notifications), "delivered to other nodes"),
        ComparisonRow(
            "command to receipt",
            f"{PAPER.receipt_ms} ms",
            _number(receipt.p50, "ms"),
            f"{_tail(receipt)}; {_sharing(report)}",
        ),
        ComparisonRow("order to receipt", "", _number(order.p50, "ms"), _tail(order)),
        ComparisonRow(
            "command to last answer", "", _number(report.last_answer_ms, "ms"), "at the ground station"
        ),
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
        ComparisonRow("minimum separation", "", _number(report.min_separation_m, "m"), "centre to centre"),
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
            f"max {_number(report.rss_mb.max, 'MB')}; shared pages count in each (RSS)",
        ),
        ComparisonRow(
            "memory per node, shared divided",
            "",
            _number(report.pss_mb.mean, "MB"),
            f"max {_number(report.pss_mb.max, 'MB')}; PSS",
        ),
    ]


def markdown(report: ExperimentReport) -> str:
    """The comparison as a table in Markdown."""
    names = [column.name for column in columns(report)]
    lines = [f"| {' | '.join(names)} |".replace("|  |", "| |"), "|" + "---|" * len(names)]
    lines += [f"| {' | '.join(row)} |" for row in cells(report, "–")]
    return "\n".join(lines) + "\n"


def columns(report: ExperimentReport) -> tuple[Column, ...]:
    """Columns of the comparison; the paper's only for a run with as many nodes."""
    paper = (Column("paper", right=True),) if comparable(report) else ()
    return (Column(""), *paper, Column("here", right=True), Column(""))


def cells(report: ExperimentReport, absent: str = "") -> list[list[str]]:
    """Cells of the comparison, one for each column; `absent` where the paper has no figure."""
    rows = comparison(report)
    if comparable(report):
        return [[row.what, row.paper or absent, row.ours, row.note] for row in rows]
    return [[row.what, row.ours, row.note] for row in rows]


def shortfalls(report: ExperimentReport) -> list[str]:
    """Reasons why the experiment failed, each as a sentence; none when it passed."""
    found = []
    if not report.completed:
        found.append("the mission was not completed")
    if report.collisions:
        found.append(f"{report.collisions} collision{'s' if report.collisions > 1 else ''}")
    return found


def misses(report: ExperimentReport, limits: ReportLimits = LIMITS) -> list[str]:
    """Missed goals, each with its limit; they fail the experiment only with `--strict`."""
    wanted = (
        ("ready", report.ready_s, limits.ready_s, "s"),
        ("mean formation error", report.formation_error_m.mean, limits.formation_error_m, "m"),
        ("command to receipt, p50", report.command_to_receipt_ms.p50, limits.receipt_p50_ms, "ms"),
        ("command to receipt, p99", report.command_to_receipt_ms.p99, limits.receipt_p99_ms, "ms"),
        ("command to last answer", report.last_answer_ms, limits.last_answer_ms, "ms"),
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


def _sharing(report: ExperimentReport) -> str:
    """Reason why a delay is longer than the paper's, whose nodes have a computer each."""
    return f"all {report.nodes} nodes share {report.host.cores} cores"


def _tail(values: Percentiles) -> str:
    return f"p99 {_number(values.p99, 'ms')}, max {_number(values.max, 'ms')}"
