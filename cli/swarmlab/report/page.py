"""The report as one self-contained HTML file: charts as SVG, a replay, no reference to anything outside."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import PurePosixPath
from string import Template
from typing import Final

import numpy as np

from swarmlab.report import charts, link_chart, replay, timeline_chart
from swarmlab.report import report as figures
from swarmlab.report.flight_map import flight_map
from swarmlab.report.plot_data import NodeFigures, PlotData
from swarmlab.report.report import ExperimentReport
from swarmlab.report.run_metadata import RunMetadata
from swarmlab.report.svg import element, rectangle

KINDS: Final = {
    "gcs": "ground station",
    "uav": "air vehicle",
    "ugv": "ground vehicle",
    "usv": "surface vessel",
}
_NODE_COLUMNS: Final = (
    "node", "mission", "sent kB/s", "received kB/s", "receipt ms", "slot error m", "clock p95 µs", "CPU %",
    "RSS MB", "clock offset s", "drift ppm", "restarts", "logs",
)  # fmt: skip
_FILES: Final = (
    ("report.json", "figures"),
    ("run.json", "the run"),
    ("run.mcap", "logs of all nodes for Foxglove and PlotJuggler"),
    ("logs/", "MCAP segments and output of every node"),
)
_TEXTS: Final = 2
"""Number of leading columns with text."""


@cache
def _asset(name: str) -> str:
    return (files("swarmlab.report") / "assets" / name).read_text("utf-8")


def page(
    data: PlotData,
    report: ExperimentReport,
    metadata: RunMetadata,
    remarks: Sequence[str],
    exists: Callable[[str], bool],
) -> str:
    """The page. `exists`: whether its folder has a file of that relative path; only such files are linked."""
    # missed goals of time do not count: they depend on the computer
    good = report.completed and not report.collisions
    note = figures.comparison_note(report)
    return Template(_asset("page.html")).substitute(
        title=escape(data.title),
        subtitle=escape(data.subtitle),
        state="good" if good else "bad",
        outcome="completed" if good else "failed",
        style=_asset("page.css"),
        script=_asset("page.js"),
        remarks=_remarks(remarks),
        figures=_comparison(report) + (f"<p class=note>{escape(_sentence(note))}</p>" if note else ""),
        legend=_kinds(data),
        map=flight_map(data),
        replay_note=(
            f"Replay: a position every {replay.step_ms(data) / 1000:g} s, rounded to 1 cm."
            if data.tracks
            else ""
        ),
        heights=charts.heights(data),
        timeline=_timeline(data),
        formation=charts.formation(data),
        formation_note=escape(_formation_note(data)),
        receipts=charts.receipts(data, report),
        receipts_note=escape(_receipts_note(report)),
        links=_links(data),
        traffic_per_node=charts.traffic_per_node(data, report),
        traffic_total=charts.traffic_total(data, report),
        nodes=_nodes(data, exists),
        origin=_origin(data, report, metadata, exists),
        paper_note=(
            "The paper's figures are of its own 16 computers on a Gigabit switch."
            if figures.comparable(report)
            else ""
        ),
        replay=replay.encoded(data),
    )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _remarks(remarks: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(remark)}</li>" for remark in remarks)
    return f'<ul class="remarks">{items}</ul>' if items else ""


def _comparison(report: ExperimentReport) -> str:
    columns = figures.columns(report)
    numbers = [column.right for column in columns]
    ours = len(columns) - 2
    head = "".join(
        f"<th scope=col{' class=n' if right else ''}>{escape(column.name)}</th>"
        for column, right in zip(columns, numbers, strict=True)
    )
    rows = []
    for name, *rest in figures.cells(report):
        cells = [f"<th scope=row>{escape(name)}</th>"]
        for i, cell in enumerate(rest, 1):
            kind = "n ours" if i == ours else "n" if numbers[i] else "note"
            cells.append(f'<td class="{kind}">{escape(cell)}</td>')
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _swatch(kind: str, name: str) -> str:
    mark = element(
        "svg", {"viewBox": "0 0 14 9", "aria-hidden": "true"}, rectangle(0.0, 0.0, 14.0, 9.0, kind)
    )
    return f"<li>{mark}{escape(name)}</li>"


def _kinds(data: PlotData) -> str:
    kinds = sorted({data.kinds[name] for name in data.tracks})
    items = "".join(_swatch(f"bar {kind}", KINDS.get(kind, kind)) for kind in kinds)
    return f'<ul class="legend-list">{items}</ul>'


def _timeline(data: PlotData) -> str:
    if not data.timelines:
        return "<p class=note>The logs have no steps of a mission.</p>"
    items = "".join(_swatch(f"block {kind}", name) for kind, name in timeline_chart.legend(data))
    barriers = "".join(f"<li>{escape(timeline_chart.passage_text(found))}</li>" for found in data.barriers)
    return (
        f'<ul class="legend-list">{items}</ul>'
        f"<figure>{_scrolled('mission timeline', timeline_chart.timeline(data))}"
        "<figcaption>Blocks of every member; pale: it waits. Vertical lines: a barrier "
        "opens for all members at one common instant.</figcaption></figure>"
        f"<details><summary>{len(data.barriers)} barriers in numbers</summary><ul>{barriers}</ul></details>"
    )


def _formation_note(data: PlotData) -> str:
    worst = ""
    largest = -np.inf
    for name, series in data.formation_errors.items():
        formed = np.zeros(len(series.t_s), dtype=np.bool_)
        for start_s, end_s in data.formed:
            formed |= (series.t_s >= start_s) & (series.t_s <= end_s)
        values = np.where(formed & np.isfinite(series.value), series.value, -np.inf)
        if len(values) and values.max() > largest:
            at = int(np.argmax(values))
            largest = float(values[at])
            worst = f" Largest error once formed: {name}, {largest:.2f} m at {series.t_s[at]:.1f} s."
    return (
        "Distance of each follower from its slot; the axis is logarithmic, and errors below "
        f"{charts.FINEST_M:g} m are drawn at its low end.{worst}"
    )


def _receipts_note(report: ExperimentReport) -> str:
    return (
        f"{len(report.receipts)} vehicles, one dot each. Full line: from the command at the ground station "
        "until the broker of a vehicle receives its order, in true time; dashed line, open dots: from the "
        "sending of the order."
    )


def _links(data: PlotData) -> str:
    drawn = link_chart.matrices(data)
    words = f"<p>{escape(link_chart.summary(data).text)}</p>"
    if not drawn:
        return words
    return f"{words}<figure>{_scrolled('links', drawn)}</figure>"


def _scrolled(name: str, content: str) -> str:
    return f'<div class="scroll" tabindex="0" role="region" aria-label="{name}">{content}</div>'


def _nodes(data: PlotData, exists: Callable[[str], bool]) -> str:
    head = "".join(
        f"<th scope=col{'' if i < _TEXTS or name == 'logs' else ' class=n'}>{escape(name)}</th>"
        for i, name in enumerate(_NODE_COLUMNS)
    )
    rows = "".join(_node(node, exists) for node in data.nodes)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _node(node: NodeFigures, exists: Callable[[str], bool]) -> str:
    numbers = (  # with equally many decimals in a column: their points are in one line
        (node.egress_kbps, 2),
        (node.ingress_kbps, 1),
        (node.receipt_ms, 1),
        (node.formation_error_m, 3),
        (node.clock_error_us, 1),
        (node.cpu_percent, 2),
        (node.rss_mb, 1),
        (node.offset_s, 3),
        (node.drift_ppm, 2),
        (node.restarts, 0),
    )
    right = "".join(
        f"<td class=n>{'' if number is None else f'{number:.{decimals}f}'}</td>"
        for number, decimals in numbers
    )
    folder = f"{PurePosixPath(node.log).parent}/"
    places = ((folder, "MCAP"), (node.log, "output")) if node.log else ()
    logs = " ".join(f'<a href="{escape(place)}">{name}</a>' for place, name in places if exists(place))
    left = f"<th scope=row>{escape(node.platform)}</th><td>{escape(node.outcome)}</td>"
    return f"<tr>{left}{right}<td class=logs>{logs}</td></tr>"


def _origin(
    data: PlotData, report: ExperimentReport, metadata: RunMetadata, exists: Callable[[str], bool]
) -> str:
    host = report.host
    started = datetime.fromtimestamp(metadata.started_utc_ns / 1e9, UTC)
    load = "" if host.load_before is None else f"{host.load_before:.2f} before the start"
    if host.nodes_percent is not None and host.others_percent is not None:
        load += (
            f"; during the mission the nodes used {host.nodes_percent:.0f} % of a core, "
            f"other processes {host.others_percent:.0f} %"
        )
    versions = ", ".join(f"{name} {version}" for name, version in metadata.versions.items())
    rows = (
        ("command", f"<code>{escape(metadata.command)}</code>" if metadata.command else ""),
        ("again from the logs", "<code>swarmctl lab report FOLDER</code>"),
        ("started", f"{started:%Y-%m-%d %H:%M:%S} UTC"),
        ("duration", f"{data.duration_s:.1f} s from the command to the end of the last mission"),
        ("processor", escape(f"{host.processor}, {host.cores} cores")),
        ("kernel", escape(host.kernel)),
        ("load", escape(load)),
        (
            "swarmware",
            escape(f"{metadata.version}" + (f", commit {metadata.commit}" if metadata.commit else "")),
        ),
        ("versions", escape(versions)),
        ("network, seed", escape(f"{metadata.net}, {metadata.seed}")),
        (
            "files",
            ", ".join(f'<a href="{name}">{name}</a> ({what})' for name, what in _FILES if exists(name)),
        ),
    )
    return f"<dl>{''.join(f'<dt>{name}</dt><dd>{value}</dd>' for name, value in rows if value)}</dl>"
