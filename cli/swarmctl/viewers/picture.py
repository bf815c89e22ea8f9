"""The picture of a topology: its layout, the colours of kinds and the meaning of lines."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import msgspec

from swarmware.model.platform_kind import PlatformKind

COLOURS: Final[dict[str, str]] = {
    PlatformKind.UGV: "#d55e00",
    PlatformKind.UAV: "#0072b2",
    PlatformKind.GCS: "#009e73",
    PlatformKind.USV: "#56b4e9",
}
"""Okabe and Ito's palette: distinguishable with every kind of colour vision."""
UNKNOWN_COLOUR: Final = "#1f2933"
_LINE: Final = (0.243, 0.298, 0.349)
_FAINTEST: Final = 0.08
_DARKEST: Final = 0.55


class DrawnLink(msgspec.Struct, frozen=True):
    """A line between two nodes."""

    a: str
    b: str
    quality: float
    """Share of the datagrams that arrive, of the worse direction, 0–1."""
    both: bool = True
    """Whether the link is bidirectional; otherwise the line is dashed."""


def colour(kind: str) -> str:
    """Colour of a node of this kind."""
    return COLOURS.get(kind, UNKNOWN_COLOUR)


def circle(nodes: list[str]) -> dict[str, tuple[float, float]]:
    """Places of the nodes on the unit circle: the first at the top, then clockwise."""
    angles = [math.pi / 2 - math.tau * number / len(nodes) for number in range(len(nodes))]
    return {node: (math.cos(angle), math.sin(angle)) for node, angle in zip(nodes, angles, strict=True)}


def draw_topology(axes: Any, nodes: Mapping[str, str], links: Iterable[DrawnLink], title: str) -> None:
    """Draw nodes with their kinds and links; a line is darker where more of the datagrams arrive.

    `axes`: of matplotlib, which the caller has imported.
    """
    place = circle(list(nodes))
    for link in links:
        (x0, y0), (x1, y1) = place[link.a], place[link.b]
        # never invisible: a link that loses all datagrams is still known
        strength = _FAINTEST + (_DARKEST - _FAINTEST) * min(max(link.quality, 0.0), 1.0)
        style = "-" if link.both else "--"
        axes.plot([x0, x1], [y0, y1], color=_LINE, alpha=strength, linewidth=1, linestyle=style, zorder=1)
    for node, (x, y) in place.items():
        axes.plot(
            x, y, marker="o", markersize=15, color=colour(nodes[node]), markeredgecolor="white", zorder=3
        )
        axes.text(1.16 * x, 1.16 * y, node, ha="center", va="center", fontsize=9.5)
    axes.set_title(title)
    axes.set_xlim(-1.4, 1.4)
    axes.set_ylim(-1.3, 1.3)
    axes.set_aspect("equal")
    axes.axis("off")
