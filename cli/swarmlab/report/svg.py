"""SVG as text: elements, labels, lines with few points."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import Final

import numpy as np

from swarmlab.measure.tracks import Floats, runs

Points = Floats
"""Shape (N, 2), in pixels."""

WIDTH: Final = 960
LEFT: Final = 58.0
RIGHT: Final = 872.0
"""End of the plot area; the names of the lines are beside it."""
SIZE: Final = 12.0
"""Font size of labels."""
TOLERANCE_PX: Final = 0.25
"""Maximum distance of a drawn line from the data: not visible."""


def number(value: float) -> str:
    """A coordinate with one digit after the point."""
    shown = f"{value:.1f}".removesuffix(".0")
    return "0" if shown == "-0" else shown


def element(name: str, attributes: Mapping[str, object], *content: str) -> str:
    """An element; its content is markup already."""
    shown = "".join(
        f' {key}="{escape(number(value) if isinstance(value, float) else str(value))}"'
        for key, value in attributes.items()
    )
    return f"<{name}{shown}>{''.join(content)}</{name}>"


def title(text: str) -> str:
    """The tooltip of the element that contains it."""
    return element("title", {}, escape(text))


def text(content: str, x: float, y: float, kind: str = "", anchor: str = "start", **more: object) -> str:
    """A label; x and y are the end of its baseline that `anchor` names."""
    attributes: dict[str, object] = {"x": x, "y": y}
    if kind:
        attributes["class"] = kind
    if anchor != "start":
        attributes["text-anchor"] = anchor
    return element("text", {**attributes, **more}, escape(content))


def line(x1: float, y1: float, x2: float, y2: float, kind: str, *content: str) -> str:
    """A straight line between two points."""
    return element("line", {"x1": x1, "y1": y1, "x2": x2, "y2": y2, "class": kind}, *content)


def rectangle(x: float, y: float, width: float, height: float, kind: str, *content: str) -> str:
    """A rectangle with upright sides."""
    return element(
        "rect",
        {"x": x, "y": y, "width": max(width, 0.0), "height": max(height, 0.0), "class": kind},
        *content,
    )


def simplified(points: Points, tolerance_px: float = TOLERANCE_PX) -> Points:
    """The points without those that lie on the line between their neighbours.

    Source: Ramer, Douglas and Peucker, 1972/1973.
    """
    if len(points) < 3:
        return points
    keep = np.zeros(len(points), dtype=np.bool_)
    keep[[0, -1]] = True
    stack = [(0, len(points) - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        chord = points[last] - points[first]
        offsets = points[first + 1 : last] - points[first]
        length2 = float(chord @ chord)
        along = np.clip(offsets @ chord / length2, 0.0, 1.0) if length2 else np.zeros(len(offsets))
        away = np.hypot(*(offsets - along[:, None] * chord).T)
        worst = int(np.argmax(away))
        if away[worst] > tolerance_px:
            middle = first + 1 + worst
            keep[middle] = True
            stack += [(first, middle), (middle, last)]
    return points[keep]


def path(points: Points, attributes: Mapping[str, object], *content: str) -> str:
    """A line through points, interrupted where one is not finite."""
    pieces = []
    for start, stop in runs(np.asarray(np.isfinite(points).all(axis=1))):
        few = simplified(points[start:stop])
        pieces.append("M" + "L".join(f"{number(x)} {number(y)}" for x, y in few))
    return element("path", {"d": "".join(pieces), **attributes}, *content)


def document(
    name: str,
    description: str,
    height: float,
    parts: Iterable[str],
    attributes: Mapping[str, object] | None = None,
) -> str:
    """A chart as an element of the page, with a name and a description for screen readers."""
    return element(
        "svg",
        {
            "viewBox": f"0 0 {WIDTH} {number(height)}",
            "role": "img",
            "aria-label": f"{name}. {description}",
            **(attributes or {"class": "chart"}),
        },
        *parts,
    )
