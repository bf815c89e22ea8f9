"""The pictures of a report: PNG bytes from `PlotData`. Importing this imports matplotlib."""

import io
import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Rectangle

from swarmctl.commands.topo.picture import COLOURS, DrawnLink, colour, draw_topology
from swarmlab.report.plot_data import ObservedLink, PlotData
from swarmlab.report.report import Receipt
from swarmware.geometry.world import Circle, Obstacle
from swarmware.model.names import natural

DPI: Final = 130
PAPER_GLOBAL_KBPS: Final = 56.07
"""S0's global traffic with 16 nodes."""
PAPER_EGRESS_KBPS: Final = 14.89
"""S0's egress traffic per node."""
PAPER_RECEIPT_MS: Final = 11.95
"""S0's time from the command to the swarm's receipt."""

INK: Final = "#1f2933"
PALE: Final = "#9aa5b1"
GRID: Final = "#e4e7eb"
WORDS: Final = {
    "ugv": "ground vehicle",
    "uav": "air vehicle",
    "gcs": "ground station",
    "usv": "surface vessel",
}

STYLE: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 12,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "figure.facecolor": "white",
}


def paths(data: PlotData) -> bytes:
    """Paths over the world with its obstacles, and heights over time below."""

    left, right, bottom, top = _extent(data)
    world_in = max(3.0, min(8.0, 8.6 * (top - bottom) / (right - left)))

    def draw(figure: Figure) -> None:
        world, heights = figure.subplots(2, 1, gridspec_kw={"height_ratios": [world_in, 1.8]})
        world.set_xlim(left, right)
        world.set_ylim(bottom, top)
        _world(world, data)
        heights.set_title("Height")
        for name in sorted(data.tracks, key=natural):
            track = data.tracks[name]
            heights.plot(track.t_s, track.xyz_m[:, 2], color=_colour(data, name), linewidth=1, alpha=0.8)
        heights.set_ylim(0, max(1.0, 1.2 * heights.get_ylim()[1]))
        _spans(heights, data)
        heights.set_xlabel("s since the command")
        heights.set_ylabel("m")

    return _png(draw, 9.5, world_in + 3.4)


def _extent(data: PlotData) -> tuple[float, float, float, float]:
    """West, east, south and north end of all that moves, with a margin."""
    moved = [track.xyz_m for track in data.tracks.values() if len(track.t_s)]
    if not moved:
        return -20.0, 20.0, -10.0, 10.0
    every = np.concatenate(moved)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.06 * max(high[0] - low[0], high[1] - low[1], 20.0)
    return (
        float(low[0] - margin),
        float(high[0] + 2 * margin),  # room for the names at the ends
        float(low[1] - margin),
        float(high[1] + margin),
    )


def _world(ax: Axes, data: PlotData) -> None:
    ax.set_title("Paths")
    for obstacle in data.obstacles:
        ax.add_patch(_patch(obstacle))
    if data.course:
        ax.plot(
            [x for x, _ in data.course],
            [y for _, y in data.course],
            linestyle=(0, (2, 3)),
            color=PALE,
            marker="x",
            markersize=6,
            linewidth=1,
        )
    for name in sorted(data.tracks, key=natural):
        track, colour = data.tracks[name], _colour(data, name)
        if len(track.t_s) == 0:
            continue
        x, y = track.xyz_m[:, 0], track.xyz_m[:, 1]
        leads = name == data.leader
        ax.plot(x, y, color=colour, linewidth=2.2 if leads else 1.1, alpha=0.95 if leads else 0.75)
        ax.plot(x[0], y[0], marker="o", markersize=5, markerfacecolor="white", markeredgecolor=colour)
        ax.plot(x[-1], y[-1], marker="o", markersize=5, color=colour)
        ax.annotate(
            name, (x[-1], y[-1]), xytext=(4, 4), textcoords="offset points", fontsize=7.5, color=colour
        )
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("east, m")
    ax.set_ylabel("north, m")
    kinds = sorted({data.kinds[name] for name in data.tracks})
    handles = [Line2D([], [], color=COLOURS[kind], label=WORDS[kind]) for kind in kinds]
    handles.append(_mark(INK, "white", "start"))
    handles.append(_mark(INK, INK, "end"))
    if data.obstacles:
        handles.append(_mark("#7b8794", "#cbd2d9", "obstacle", "s"))
    if data.course:
        handles.append(Line2D([], [], color=PALE, marker="x", linestyle=(0, (2, 3)), label="course"))
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=6, fontsize=8.5)


def _mark(edge: str, face: str, label: str, marker: str = "o") -> Line2D:
    return Line2D(
        [],
        [],
        marker=marker,
        linestyle="",
        markeredgecolor=edge,
        markerfacecolor=face,
        color=edge,
        label=label,
    )


def _patch(obstacle: Obstacle) -> CirclePatch | Rectangle:
    look = {"facecolor": "#cbd2d9", "edgecolor": "#7b8794", "linewidth": 0.8, "zorder": 1.5}
    if isinstance(obstacle, Circle):
        return CirclePatch((obstacle.x_m, obstacle.y_m), obstacle.radius_m, **look)
    width, depth = obstacle.size_m
    corner = (obstacle.x_m - width / 2, obstacle.y_m - depth / 2)
    angle = math.degrees(obstacle.yaw_rad)
    return Rectangle(corner, width, depth, angle=angle, rotation_point="center", **look)


def formation(data: PlotData, limit_m: float) -> bytes:
    """Distance of each follower from its slot over time."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.set_title("Formation error")
        _spans(ax, data)
        errors = [data.formation_errors[name] for name in sorted(data.formation_errors, key=natural)]
        names = sorted(data.formation_errors, key=natural)
        for name, error in zip(names, errors, strict=True):
            ax.plot(error.t_s, error.value, color=_colour(data, name), linewidth=0.8, alpha=0.45)
        if errors:
            stack = np.stack([error.value for error in errors])
            seen = np.isfinite(stack).any(axis=0)
            mean = np.full(stack.shape[1], np.nan)
            mean[seen] = np.nanmean(stack[:, seen], axis=0)
            ax.plot(errors[0].t_s, mean, color=INK, linewidth=2, label="mean of the followers")
        ax.axhline(limit_m, color="#cc79a7", linestyle="--", linewidth=1, label=f"goal {limit_m:g} m (mean)")
        ax.set_yscale("symlog", linthresh=1.0)
        ax.set_ylim(bottom=0)
        ticks = [0, 0.25, 0.5, 0.75, 1, 2, 5, 10, 20, 50, 100]
        top = ax.get_ylim()[1]
        ax.set_yticks([tick for tick in ticks if tick <= top])
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.minorticks_off()
        ax.set_xlabel("s since the command")
        ax.set_ylabel("m from the slot")
        ax.legend(loc="upper right")

    return _png(draw, 9.5, 4.2)


def receipts(data: PlotData, found: Sequence[Receipt]) -> bytes:
    """The distribution of command to receipt: a bar for each platform, earliest first, in its two parts."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.set_title("Command to receipt: until the order leaves (pale), on its way (full)")
        ordered = sorted(found, key=lambda receipt: receipt.command_ms)
        y = np.arange(len(ordered))
        colours = [_colour(data, receipt.platform) for receipt in ordered]
        before_ms = [receipt.command_ms - receipt.order_ms for receipt in ordered]
        ax.barh(y, before_ms, 0.7, color=colours, alpha=0.35)
        ax.barh(y, [receipt.order_ms for receipt in ordered], 0.7, left=before_ms, color=colours)
        ax.set_yticks(y, [receipt.platform for receipt in ordered])
        ax.invert_yaxis()
        ax.axvline(PAPER_RECEIPT_MS, color="#cc79a7", linestyle="--", linewidth=1)
        ax.annotate(
            "paper", (PAPER_RECEIPT_MS, 0), xycoords=("data", "axes fraction"), xytext=(3, 4),
            textcoords="offset points", fontsize=8, color="#cc79a7",
        )  # fmt: skip
        ax.set_xlim(0, 1.08 * max([PAPER_RECEIPT_MS, *(receipt.command_ms for receipt in ordered)]))
        ax.set_xlabel("ms since the instruction")
        ax.grid(axis="y", visible=False)

    return _png(draw, 9.5, max(2.4, 1.3 + 0.24 * len(found)))


def topology(data: PlotData) -> bytes:
    """Links: a circle of nodes, lines darker where more of the datagrams arrive."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        nodes = {node.platform: node.kind for node in data.nodes}
        pairs = _pairs(tuple(n for n in data.neighbours if n.node in nodes and n.hears in nodes))
        rtts = [n.rtt_ms for n in data.neighbours if n.rtt_ms is not None]
        words = f"{len(pairs)} links between {len(nodes)} nodes"
        if rtts:
            words += f", round trip p50 {np.percentile(rtts, 50):.2f} ms"
        links = [DrawnLink(a, b, quality) for (a, b), quality in pairs.items()]
        draw_topology(ax, nodes, links, f"Topology: {words}")

    return _png(draw, 7.5, 7)


def _pairs(neighbours: tuple[ObservedLink, ...]) -> dict[tuple[str, str], float]:
    """Links without direction, each with its worse side's quality."""
    pairs: dict[tuple[str, str], float] = {}
    for link in neighbours:
        key = (min(link.node, link.hears), max(link.node, link.hears))
        pairs[key] = min(pairs.get(key, 1.0), link.quality)
    return pairs


def traffic(data: PlotData) -> bytes:
    """Bytes on the wire: each node's mean, and the whole swarm over time."""

    def draw(figure: Figure) -> None:
        bars, total = figure.subplots(2, 1, gridspec_kw={"height_ratios": [1.3, 1]})
        nodes = sorted(data.nodes, key=lambda node: natural(node.platform))
        x = np.arange(len(nodes))
        colours = [COLOURS[node.kind] for node in nodes]
        bars.bar(x - 0.2, [node.egress_kbps for node in nodes], 0.38, color=colours, label="sent")
        bars.bar(
            x + 0.2, [node.ingress_kbps for node in nodes], 0.38, color=colours, alpha=0.35, label="received"
        )
        bars.set_xticks(x, [node.platform for node in nodes], rotation=45 if len(nodes) > 8 else 0)
        bars.set_title("Traffic per node: sent (full), received (pale)")
        bars.set_ylabel("kB/s")
        bars.axhline(PAPER_EGRESS_KBPS, color="#cc79a7", linestyle="--", linewidth=1)
        bars.annotate(
            "paper: egress", (0.995, PAPER_EGRESS_KBPS), xycoords=("axes fraction", "data"),
            ha="right", va="bottom", fontsize=8, color="#cc79a7",
        )  # fmt: skip
        bars.grid(axis="x", visible=False)
        total.set_title("All nodes' egress over time")
        if data.traffic:
            series = list(data.traffic.values())
            t_s = series[0].t_s
            parts = [np.interp(t_s, s.t_s, s.value) for s in series if len(s.t_s)]
            whole = np.sum(parts, axis=0) if parts else np.zeros(len(t_s))
            total.fill_between(t_s, whole, color="#0072b2", alpha=0.2)
            total.plot(t_s, whole, color="#0072b2", linewidth=1.5)
        total.axhline(PAPER_GLOBAL_KBPS, color="#cc79a7", linestyle="--", linewidth=1)
        total.annotate(
            "paper: global, 16 nodes", (0.995, PAPER_GLOBAL_KBPS), xycoords=("axes fraction", "data"),
            ha="right", va="bottom", fontsize=8, color="#cc79a7",
        )  # fmt: skip
        _spans(total, data)
        total.set_ylim(0, total.get_ylim()[1] * 1.08)
        total.set_xlabel("s since the command")
        total.set_ylabel("kB/s")

    return _png(draw, 9.5, 7)


def _spans(ax: Axes, data: PlotData) -> None:
    for start_s, end_s in data.formed:
        ax.axvspan(start_s, end_s, color="#009e73", alpha=0.08, linewidth=0)
    if data.formed:
        ax.annotate(
            "formed", (data.formed[0][0], 1), xycoords=("data", "axes fraction"), xytext=(4, -10),
            textcoords="offset points", fontsize=8, color="#009e73",
        )  # fmt: skip


def _colour(data: PlotData, name: str) -> str:
    return colour(data.kinds.get(name, ""))


def _png(draw: Callable[[Figure], None], width_in: float, height_in: float) -> bytes:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        out = io.BytesIO()
        figure.savefig(out, format="png")
    return out.getvalue()
