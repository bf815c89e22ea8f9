"""The paths of a run as a picture for documents: PNG bytes from `PlotData`; imports matplotlib."""

import io
import math
from collections.abc import Callable
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from swarmctl.viewers.picture import COLOURS, colour
from swarmlab.report.plot_data import PlotData
from swarmware.geometry.world import Circle, Obstacle
from swarmware.model.names import natural
from swarmware.model.platform_kind import PlatformKind

DPI: Final = 130
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
        # names of air vehicles on the left: on the right they cover the ground vehicles ahead of them
        side, offset = ("right", -5) if data.kinds.get(name) == PlatformKind.UAV else ("left", 5)
        ax.annotate(
            name, (x[-1], y[-1]), xytext=(offset, 2), textcoords="offset points", ha=side, fontsize=7.5,
            color=colour, path_effects=[withStroke(linewidth=2, foreground="white")], zorder=4,
        )  # fmt: skip
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
        # without pyplot, which keeps figures in a global table and may open a display
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        out = io.BytesIO()
        figure.savefig(out, format="png")
    return out.getvalue()
