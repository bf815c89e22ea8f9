"""The charts of heights, formation errors, command to receipt, and traffic."""

from typing import Final

import numpy as np

from swarmlab.measure import tracks
from swarmlab.measure.tracks import Floats
from swarmlab.report.plot_data import PlotData
from swarmlab.report.report import LIMITS, PAPER, ExperimentReport, comparable
from swarmlab.report.scale import Scale, label, round_top
from swarmlab.report.svg import LEFT, RIGHT, document, element, line, path, rectangle, text, title
from swarmlab.report.time_chart import NamedLine, TimeChart

TOP: Final = 44.0
FINEST_M: Final = 0.01
"""Low end of the axis of formation errors; an error below it is drawn there."""
LABEL_PX: Final = 46.0
"""Room of a node below which its name is turned."""
_P50: Final = 0.5
_P99: Final = 0.99


def heights(data: PlotData) -> str:
    """Heights of all vehicles over time."""
    top_m = max(
        (float(track.xyz_m[:, 2].max()) for track in data.tracks.values() if len(track.t_s)), default=1.0
    )
    chart = TimeChart(
        "Heights",
        "Height of every vehicle over time.",
        _times(data),
        Scale(min(0.0, _lowest(data)), round_top(max(top_m, 1.0)), 220.0, TOP),
        "m",
    )
    chart.spans(data.formed, "formed")
    chart.grid("height, m")
    chart.series(
        [
            NamedLine(name, data.kinds[name], track.t_s, track.xyz_m[:, 2])
            for name, track in data.tracks.items()
        ],
        inline=True,
    )
    return chart.svg()


def _lowest(data: PlotData) -> float:
    lowest = min((float(t.xyz_m[:, 2].min()) for t in data.tracks.values() if len(t.t_s)), default=0.0)
    # noise around the ground must not extend the axis
    return 0.0 if lowest > -0.5 else float(np.floor(lowest))


def formation(data: PlotData) -> str:
    """Distance of each follower from its slot over time, on a logarithmic axis."""
    top_m = max(
        (float(np.nanmax(s.value)) for s in data.formation_errors.values() if np.isfinite(s.value).any()),
        default=1.0,
    )
    values = Scale(FINEST_M, max(2.0, 1.1 * top_m), 330.0, TOP, log=True)
    chart = TimeChart(
        "Formation error",
        "Distance of every follower from its slot over time; the axis of distances is logarithmic.",
        _times(data),
        values,
        "m",
    )
    chart.spans(data.formed, "formed")
    chart.grid("distance from the slot, m, logarithmic axis")
    found = [NamedLine(n, data.kinds[n], s.t_s, s.value) for n, s in data.formation_errors.items()]
    chart.series(found)
    if found:
        mean = _mean([one.value for one in found])
        chart.line(chart.points(found[0].t_s, mean), "mean of the followers", "mean")
    chart.level(
        LIMITS.formation_error_m, f"goal of the mean, once formed: below {LIMITS.formation_error_m:g} m"
    )
    return chart.svg()


def _mean(values: list[Floats]) -> Floats:
    stack = np.stack(values)
    known = np.isfinite(stack)
    count = known.sum(axis=0)
    total = np.where(known, stack, 0.0).sum(axis=0)
    # by hand, since `np.nanmean` warns of instants without a value
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def receipts(data: PlotData, report: ExperimentReport) -> str:
    """The empirical distributions of command to receipt, and of the part on the way."""
    whole = sorted((receipt.command_ms, receipt.platform) for receipt in report.receipts)
    parts = sorted((receipt.order_ms, receipt.platform) for receipt in report.receipts)
    top_ms = max([ms for ms, _ in whole] + [LIMITS.receipt_p99_ms * 1.15])
    times = Scale(0.0, round_top(top_ms), LEFT, RIGHT)
    shares = Scale(0.0, 1.0, 300.0, TOP + 28)
    out = []
    for value in times.ticks(10):
        x = times.px(value)
        out += [line(x, shares.end_px, x, 300.0, "grid"), text(label(value), x, 316.0, "tick", "middle")]
    for percent in (0, 25, 50, 75, 100):
        y = shares.px(percent / 100)
        out += [line(LEFT, y, RIGHT, y, "grid"), text(f"{percent} %", LEFT - 6, y + 4, "tick", "end")]
    out += [
        text("share of the vehicles whose order has arrived", LEFT, shares.end_px - 50, "legend"),
        text("ms, linear axis", (LEFT + RIGHT) / 2, 333.0, "legend", "middle"),
    ]
    paper = ", the paper's figure" if comparable(report) else ""
    goals = ((LIMITS.receipt_p50_ms, "goal of p50", ""), (LIMITS.receipt_p99_ms, "goal of p99", paper))
    for row, (limit_ms, name, note) in enumerate(goals):
        x = times.px(limit_ms)
        out.append(line(x, shares.end_px - 32 + 16 * row, x, 300.0, "goal"))
        out.append(
            text(f"{name}: below {limit_ms:g} ms{note}", x + 4, shares.end_px - 24 + 16 * row, "goalname")
        )
    for found, kind in ((parts, "part"), (whole, "whole")):
        if found:
            out += [_steps(found, times, shares, kind), *_dots(found, times, shares, data, kind)]
    for share, measured, name in (
        (_P50, report.command_to_receipt_ms.p50, "p50"),
        (_P99, report.command_to_receipt_ms.p99, "p99"),
    ):
        if measured is not None:
            x, y = times.px(measured), shares.px(share)
            out.append(line(x, y, x, 300.0, "measured", title(f"{name} {measured:.3g} ms")))
            # beside the right edge the label is on the left of its line
            right = x < RIGHT - 110
            out.append(
                text(
                    f"{name} {measured:.3g} ms",
                    x + (5 if right else -5),
                    294.0 - (18 if name == "p99" else 0),
                    "measuredname",
                    "start" if right else "end",
                )
            )
    return document(
        "Command to receipt",
        "Distribution over the vehicles of the delay from the command to the receipt of the order.",
        340.0,
        out,
    )


def _steps(found: list[tuple[float, str]], times: Scale, shares: Scale, kind: str) -> str:
    # begins at the origin: before the first receipt the share is 0
    points = [(times.px(0.0), shares.px(0.0))]
    for rank, (ms, _) in enumerate(found):
        points += [
            (times.px(ms), shares.px(rank / len(found))),
            (times.px(ms), shares.px((rank + 1) / len(found))),
        ]
    points.append((times.end_px, shares.px(1.0)))
    return path(np.array(points), {"class": f"ecdf {kind}"})


def _dots(found: list[tuple[float, str]], times: Scale, shares: Scale, data: PlotData, way: str) -> list[str]:
    of = "order to receipt" if way == "part" else "command to receipt"
    return [
        element(
            "circle",
            {
                "class": f"dot {way} {data.kinds.get(platform, '')}",
                "cx": times.px(ms),
                "cy": shares.px((rank + 1) / len(found)),
                "r": 4,
            },
            title(f"{platform}: {of} {ms:.3g} ms"),
        )
        for rank, (ms, platform) in enumerate(found)
    ]


def traffic_per_node(data: PlotData, report: ExperimentReport) -> str:
    """Mean of the bytes sent and received by each node."""
    rates = [rate for node in data.nodes for rate in (node.egress_kbps, node.ingress_kbps)]
    show_paper = comparable(report)
    values = Scale(0.0, round_top(max([*rates, PAPER.egress_kbps if show_paper else 0.0, 0.1])), 220.0, TOP)
    out = [text("mean of the mission, kB/s (sent: full, received: pale)", LEFT, TOP - 8, "legend")]
    for value in values.ticks(5):
        y = values.px(value)
        out += [line(LEFT, y, RIGHT, y, "grid"), text(label(value), LEFT - 6, y + 4, "tick", "end")]
    room = (RIGHT - LEFT) / max(1, len(data.nodes))
    for i, node in enumerate(data.nodes):
        bars = ((node.egress_kbps, "sent", ""), (node.ingress_kbps, "received", "pale "))
        for side, (rate, verb, pale) in enumerate(bars):
            y = values.px(rate)
            x = LEFT + room * (i + 0.1 + 0.4 * side)
            tip = f"{node.platform}: {verb} {rate:.3g} kB/s"
            out.append(rectangle(x, y, room * 0.38, 220.0 - y, f"bar {pale}{node.kind}", title(tip)))
        x = LEFT + room * (i + 0.5)
        # names would overlap, so they are turned
        if room < LABEL_PX:
            turn = f"rotate(-90 {x + 4:.1f} 228)"
            out.append(text(node.platform, x + 4, 228.0, "tick", "end", transform=turn))
        else:
            out.append(text(node.platform, x, 236.0, "tick", "middle"))
    if show_paper:
        y = values.px(PAPER.egress_kbps)
        name = f"paper, sent per node: {PAPER.egress_kbps:g} kB/s"
        out += [line(LEFT, y, RIGHT, y, "goal"), text(name, RIGHT, TOP - 8, "goalname", "end")]
    return document("Traffic per node", "Bytes sent and received by each node per second.", 280.0, out)


def traffic_total(data: PlotData, report: ExperimentReport) -> str:
    """Bytes sent by all nodes together over time."""
    series = [s for s in data.traffic.values() if len(s.t_s)]
    t_s = tracks.axis(0.0, data.duration_s, 1.0)
    whole = np.sum([np.interp(t_s, s.t_s, s.value) for s in series], axis=0) if series else np.zeros(len(t_s))
    show_paper = comparable(report)
    top_kbps = max(float(whole.max(initial=0.1)), PAPER.global_kbps if show_paper else 0.0)
    chart = TimeChart(
        "Traffic of the swarm",
        "Bytes sent by all nodes together over time.",
        _times(data),
        Scale(0.0, round_top(1.05 * top_kbps), 220.0, TOP),
        "kB/s",
    )
    chart.spans(data.formed, "formed")
    chart.grid("sent by all nodes, kB/s, mean of 1 s")
    chart.series([NamedLine("all nodes", "total", t_s, whole)])
    if show_paper:
        chart.level(PAPER.global_kbps, f"paper, 16 nodes: {PAPER.global_kbps:g} kB/s")
    return chart.svg()


def _times(data: PlotData) -> Scale:
    return Scale(0.0, max(data.duration_s, 1.0), LEFT, RIGHT)
