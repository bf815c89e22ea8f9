"""The map of a flight: obstacles, course, true paths with the names of the vehicles."""

import math

import numpy as np

from swarmlab.report import labels
from swarmlab.report.plot_data import PlotData
from swarmlab.report.scale import label, round_step
from swarmlab.report.svg import (
    LEFT,
    SIZE,
    WIDTH,
    document,
    element,
    line,
    number,
    path,
    rectangle,
    text,
    title,
)
from swarmware.geometry.world import Circle, Obstacle

TOP = 12.0
MAX_HEIGHT = 620.0
END = WIDTH - 16.0


class MapFrame:
    """The part of the world that a map shows, and its place on the chart: one scale for both axes."""

    def __init__(self, data: PlotData) -> None:
        west, south, east, north = _extent(data)
        # one scale for both axes, or circles and angles would be distorted
        self.px_m = min((END - LEFT) / (east - west), MAX_HEIGHT / (north - south))
        self.west, self.north = west, north
        self.right = LEFT + (east - west) * self.px_m
        self.bottom = TOP + (north - south) * self.px_m

    def x(self, x_m: float) -> float:
        """Pixel of an east coordinate."""
        return LEFT + (x_m - self.west) * self.px_m

    def y(self, y_m: float) -> float:
        """Pixel of a north coordinate."""
        return TOP + (self.north - y_m) * self.px_m

    def grid(self) -> str:
        """Lines at round distances, the same in both directions."""
        step_m = round_step(80.0 / self.px_m)
        parts = [rectangle(LEFT, TOP, self.right - LEFT, self.bottom - TOP, "frame")]
        for x_m in _multiples(step_m, self.west, self.west + (self.right - LEFT) / self.px_m):
            parts += [
                line(self.x(x_m), TOP, self.x(x_m), self.bottom, "grid"),
                text(label(x_m), self.x(x_m), self.bottom + 16, "tick", "middle"),
            ]
        for y_m in _multiples(step_m, self.north - (self.bottom - TOP) / self.px_m, self.north):
            parts += [
                line(LEFT, self.y(y_m), self.right, self.y(y_m), "grid"),
                text(label(y_m), LEFT - 6, self.y(y_m) + 4, "tick", "end"),
            ]
        middle = (TOP + self.bottom) / 2
        parts += [
            text("east, m", (LEFT + self.right) / 2, self.bottom + 33, "legend", "middle"),
            text("north, m", 14, middle, "legend", "middle", transform=f"rotate(-90 14 {number(middle)})"),
        ]
        return "".join(parts)


def flight_map(data: PlotData) -> str:
    """All paths of a run; the replay of the page moves the vehicles on it."""
    frame = MapFrame(data)
    below = [_obstacle(obstacle, frame) for obstacle in data.obstacles]
    if data.course:
        corners = np.array([(frame.x(x_m), frame.y(y_m)) for x_m, y_m in data.course])
        below.append(path(corners, {"class": "course"}, title("course of the leader")))
    window = rectangle(LEFT, TOP, frame.right - LEFT, frame.bottom - TOP, "")
    parts = [
        frame.grid(),
        # obstacles may extend beyond the part that is shown
        element("clipPath", {"id": "world"}, window),
        element("g", {"clip-path": "url(#world)"}, *below),
    ]
    ends = []
    for name, track in data.tracks.items():
        if not len(track.t_s):
            continue
        points = np.stack(
            [
                LEFT + (track.xyz_m[:, 0] - frame.west) * frame.px_m,
                TOP + (frame.north - track.xyz_m[:, 1]) * frame.px_m,
            ],
            axis=1,
        )
        kind = f"{data.kinds[name]}{' leads' if name == data.leader else ''}"
        parts.append(
            path(points, {"class": f"series {kind}", "data-name": name}, title(_described(data, name)))
        )
        for at, mark in ((0, "start"), (-1, "end")):
            x, y = (float(value) for value in points[at])
            dot = {"class": f"{mark} {data.kinds[name]}", "cx": x, "cy": y, "r": 3.5}
            parts.append(element("circle", dot, title(f"{mark} of {name}")))
        ends.append((name, float(points[-1, 0]), float(points[-1, 1])))
    area = labels.LabelBox(LEFT, TOP, frame.right, frame.bottom)
    parts += [
        text(placed.text, placed.x, placed.y, f"name {data.kinds[placed.text]}")
        for placed in labels.around(ends, SIZE, area)
    ]
    return document(
        "Paths",
        f"Map of the true paths of {len(data.tracks)} vehicles, both axes in metres to one scale.",
        frame.bottom + 40,
        parts,
        {
            "class": "chart map",
            "id": "map",
            "data-west": f"{frame.west:.3f}",
            "data-north": f"{frame.north:.3f}",
            "data-left": number(LEFT),
            "data-top": number(TOP),
            "data-scale": f"{frame.px_m:.4f}",
        },
    )


def _described(data: PlotData, name: str) -> str:
    track = data.tracks[name]
    length_m = float(np.hypot(*np.diff(track.xyz_m[:, :2], axis=0).T).sum())
    role = ", leader" if name == data.leader else ""
    return f"{name}{role}: {length_m:.0f} m over ground, up to {float(track.xyz_m[:, 2].max()):.1f} m high"


def _extent(data: PlotData) -> tuple[float, float, float, float]:
    """West, south, east and north end of all that moves, with a margin."""
    moved = [track.xyz_m[:, :2] for track in data.tracks.values() if len(track.t_s)]
    # a run that failed early has no path, and still needs a map
    if not moved:
        return -20.0, -10.0, 20.0, 10.0
    every = np.concatenate(moved)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.06 * max(float(high[0] - low[0]), float(high[1] - low[1]), 20.0)
    return (
        float(low[0]) - margin,
        float(low[1]) - margin,
        float(high[0]) + 1.6 * margin,  # room for the names at the ends
        float(high[1]) + margin,
    )


def _multiples(step: float, low: float, high: float) -> list[float]:
    return [number * step for number in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _obstacle(obstacle: Obstacle, frame: MapFrame) -> str:
    x, y = frame.x(obstacle.x_m), frame.y(obstacle.y_m)
    tip = title(f"obstacle {obstacle.name}, {obstacle.height_m:g} m high")
    if isinstance(obstacle, Circle):
        round_shape = {"cx": x, "cy": y, "r": obstacle.radius_m * frame.px_m}
        return element("circle", {"class": "obstacle", **round_shape}, tip)
    wide, deep = (size_m * frame.px_m for size_m in obstacle.size_m)
    turned = f"rotate({-math.degrees(obstacle.yaw_rad):.2f} {number(x)} {number(y)})"
    shape = {"x": x - wide / 2, "y": y - deep / 2, "width": wide, "height": deep, "transform": turned}
    return element("rect", {"class": "obstacle", **shape}, tip)
