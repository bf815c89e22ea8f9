"""Charts over time: axes, shaded spans, lines with names and tooltips."""

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec
import numpy as np

from swarmlab.measure.tracks import Floats
from swarmlab.report import labels
from swarmlab.report.scale import Scale, label
from swarmlab.report.svg import SIZE, Points, document, line, number, path, rectangle, text, title

LEVEL_PX: Final = 13.0
"""Distance of the baselines of two labels."""
LEGEND_PX: Final = 21.0
"""Distance of the legend from the top of the chart; the names of spans are between them."""
NAMES_FROM: Final = 0.3
"""Share of the axis before the first name on a line: the vehicles have spread by then."""


class NamedLine(msgspec.Struct, frozen=True):
    """A named line of a chart over time."""

    name: str
    kind: str
    """CSS classes of the line and its name."""
    t_s: Floats
    value: Floats


class TimeChart:
    """A chart over time: axes, spans, lines with names and tooltips, a cursor for the replay."""

    def __init__(self, name: str, description: str, times: Scale, values: Scale, unit: str) -> None:
        self._name = name
        self._description = description
        self.times = times
        self.values = values
        self._unit = unit
        self._parts: list[str] = []
        self._bottom = max(values.start_px, values.end_px)
        self._top = min(values.start_px, values.end_px)

    def add(self, *parts: str) -> None:
        """Adds elements above the earlier ones."""
        self._parts += parts

    def grid(self, legend: str) -> None:
        """Axes with their ticks and the meaning of the values."""
        self.add(time_axis(self.times, self._top, self._bottom))
        for value in self.values.ticks():
            y = self.values.px(value)
            self.add(
                line(self.times.start_px, y, self.times.end_px, y, "grid"),
                text(label(value), self.times.start_px - 6, y + 4, "tick", "end"),
            )
        self.add(text(legend, self.times.start_px, self._top - LEGEND_PX, "legend"))

    def spans(self, found: Iterable[tuple[float, float]], name: str) -> None:
        """Shaded spans of time with their name above; before the lines, which are drawn over them."""
        for start_s, end_s in found:
            x1, x2 = self.times.px(start_s), self.times.px(end_s)
            tip = title(f"{name}: {start_s:.1f}–{end_s:.1f} s")
            self.add(rectangle(x1, self._top, x2 - x1, self._bottom - self._top, "span", tip))
            self.add(text(name, x1, self._top - 5, "spanname"))

    def level(self, value: float, name: str, kind: str = "goal") -> None:
        """A horizontal line; its name is at the right above the chart."""
        y = self.values.px(value)
        self.add(line(self.times.start_px, y, self.times.end_px, y, kind))
        start = self.times.end_px - labels.width(name, SIZE) - 28
        self.add(line(start, self._top - LEGEND_PX - 4, start + 22, self._top - LEGEND_PX - 4, kind))
        self.add(text(name, start + 28, self._top - LEGEND_PX, f"{kind}name"))

    def series(self, found: Sequence[NamedLine], *, inline: bool = False) -> None:
        """Lines with their names, as many as fit, at the right end or on the line; each has a tooltip."""
        drawn = [(one, self.points(one.t_s, one.value)) for one in found]
        for one, points in drawn:
            self.line(points, one.name, one.kind)
        if inline:
            self._names_on_lines(drawn)
        else:
            self._names_at_ends(drawn)

    def points(self, t_s: Floats, value: Floats) -> Points:
        """Pixels of a line; not finite where the value is not."""
        if not len(t_s):
            return np.empty((0, 2))
        y = [self.values.px(float(v)) if np.isfinite(v) else np.nan for v in value]
        return np.stack([[self.times.px(float(at_s)) for at_s in t_s], y], axis=1)

    def line(self, points: Points, name: str, kind: str) -> None:
        """A line with a tooltip."""
        self.add(path(points, {"class": f"series {kind}", "data-name": name}, title(name)))

    def _names_at_ends(self, drawn: Sequence[tuple[NamedLine, Points]]) -> None:
        ends: list[tuple[NamedLine, float, float]] = []
        for one, points in drawn:
            known = np.flatnonzero(np.isfinite(points).all(axis=1))
            if len(known):
                ends.append((one, float(points[known[-1], 0]), float(points[known[-1], 1])))
        places = labels.spread([y for _, _, y in ends], LEVEL_PX, self._top + 4, self._bottom)
        if places is None:
            return
        for (one, x, y), at in zip(ends, places, strict=True):
            start = self.times.end_px + 14
            self.add(
                path(np.array([(x, y), (self.times.end_px + 3, y), (start - 2, at)]), {"class": "leader"}),
                text(one.name, start, at + 4, f"name {one.kind}"),
            )

    def _names_on_lines(self, drawn: Sequence[tuple[NamedLine, Points]]) -> None:
        taken: list[labels.LabelBox] = []
        for one, points in drawn:
            wide = labels.width(one.name, SIZE)
            for at in np.flatnonzero(np.isfinite(points).all(axis=1)):
                x, y = float(points[at, 0]), float(points[at, 1])
                box = labels.LabelBox(x, y - 6, x + wide + 4, y + 6)
                early = x < self.times.start_px + NAMES_FROM * (self.times.end_px - self.times.start_px)
                if early or box.right > self.times.end_px or any(box.overlaps(other) for other in taken):
                    continue
                taken.append(box)
                self.add(text(one.name, x, y + 4, f"name inline {one.kind}"))
                break

    def svg(self) -> str:
        """The chart as an element of the page."""
        ends = " ".join(number(px) for px in (self.values.start_px, self.values.end_px))
        return document(
            self._name,
            self._description,
            self._bottom + 40,
            self._parts,
            {
                "class": "chart time",
                "data-t": f"{self.times.low:g} {self.times.high:g}",
                "data-x": f"{number(self.times.start_px)} {number(self.times.end_px)}",
                "data-v": f"{self.values.low:g} {self.values.high:g}",
                "data-y": ends,
                "data-top": number(self._top),
                "data-axis": "log" if self.values.log else "linear",
                "data-unit": self._unit,
            },
        )


def time_axis(times: Scale, top: float, bottom: float) -> str:
    """The axis of seconds since the command, below the chart."""
    parts = []
    for t_s in times.ticks(10):
        x = times.px(t_s)
        parts += [line(x, top, x, bottom, "grid"), text(label(t_s), x, bottom + 16, "tick", "middle")]
    middle = (times.start_px + times.end_px) / 2
    return "".join([*parts, text("s since the command", middle, bottom + 33, "legend", "middle")])
