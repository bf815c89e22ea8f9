"""Places of labels: no two overlap."""

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

WIDTH_EM: Final = 0.62
"""Upper bound of the mean width of a character of common sans-serif fonts, in font sizes."""
_ROUND: Final = tuple(
    offset
    for far in (6.0, 16.0, 28.0, 42.0, 58.0)
    for offset in ((far, -4), (far, 10), (-far, -4), (-far, 10), (0, -far), (0, far + 8))
)
"""Offsets of a label from its point, nearest first."""


class LabelBox(msgspec.Struct, frozen=True):
    """A rectangle on the chart, in pixels."""

    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: "LabelBox") -> bool:
        """Whether two rectangles have an area in common."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )


class PlacedLabel(msgspec.Struct, frozen=True):
    """A label with its place: the left end of its baseline."""

    text: str
    x: float
    y: float
    box: LabelBox


def width(text: str, size: float) -> float:
    """Upper bound of the width of a text."""
    return len(text) * WIDTH_EM * size


def spread(wanted: Sequence[float], gap: float, low: float, high: float) -> list[float] | None:
    """Places as near to the wanted ones as the gap between neighbours allows, or None if they do not fit."""
    if (len(wanted) - 1) * gap > high - low:
        return None
    order = sorted(range(len(wanted)), key=lambda i: wanted[i])
    places = [0.0] * len(wanted)
    at = low - gap
    for i in order:
        at = places[i] = max(wanted[i], at + gap)
    at = high + gap
    # from the other end: the first pass may have pushed labels beyond the limit
    for i in reversed(order):
        at = places[i] = min(places[i], at - gap)
    return places


def around(points: Iterable[tuple[str, float, float]], size: float, area: LabelBox) -> list[PlacedLabel]:
    """Labels beside their points, inside the area; a label without a free place is left out."""
    taken: list[PlacedLabel] = []
    for text, x, y in points:
        for dx, dy in _ROUND:
            wide = width(text, size)
            left = x + dx if dx > 0 else x + dx - wide if dx < 0 else x - wide / 2
            base = y + dy
            box = LabelBox(left, base - 0.8 * size, left + wide, base + 0.25 * size)
            inside = (
                box.left >= area.left
                and box.right <= area.right
                and box.top >= area.top
                and box.bottom <= area.bottom
            )
            if inside and not any(box.overlaps(other.box) for other in taken):
                taken.append(PlacedLabel(text, left, base, box))
                break
    return taken
