"""A map of the swarm as lines of text: nodes at their positions, links between them."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

MARK: Final = "●"
LINK: Final = "·"
ONE_WAY: Final = "╌"
ASPECT: Final = 2.0
"""Height of a character by its width, in a terminal."""


class MapLink(NamedTuple):
    """A line between two nodes."""

    a: str
    b: str
    both: bool
    """Whether the link is bidirectional."""


def draw_map(
    places: Mapping[str, tuple[float, float]], links: Iterable[MapLink], width: int, height: int
) -> list[str]:
    """Nodes at their places (east, north, in metres), one scale for both axes, and a line with the scale.

    A name that has no room beside its node is left out; `height` includes the line with the scale.
    """
    rows, columns = max(height - 1, 3), max(width, 20)
    cells = [[" "] * columns for _ in range(rows)]
    if not places:
        return ["".join(row).rstrip() for row in cells] + ["no position is known"]
    step_m = _step_m(places.values(), columns, rows)
    middle_x, middle_y = _middle(places.values())
    at = {
        name: (
            round((columns - 1) / 2 + (x_m - middle_x) / step_m),
            round((rows - 1) / 2 - (y_m - middle_y) / (step_m * ASPECT)),
        )
        for name, (x_m, y_m) in places.items()
    }
    for link in links:
        if link.a in at and link.b in at:
            _draw_line(cells, at[link.a], at[link.b], LINK if link.both else ONE_WAY)
    # after the lines, which may end in the same cell
    for column, row in at.values():
        cells[row][column] = MARK
    for name, (column, row) in at.items():
        _write_name(cells[row], column, name)
    bar = max(1, round(_round_length_m(step_m * columns / 5) / step_m))
    scale = f"├{'─' * max(bar - 2, 0)}┤ {bar * step_m:.3g} m   north is up"
    return ["".join(row).rstrip() for row in cells] + [scale[:columns]]


def _step_m(places: Iterable[tuple[float, float]], columns: int, rows: int) -> float:
    """Metres per column, so that all places and their names have room."""
    places = list(places)
    wide = max(x for x, _ in places) - min(x for x, _ in places)
    high = max(y for _, y in places) - min(y for _, y in places)
    names = 14  # columns for names at both sides
    return max(wide / max(columns - names, 4), high / ASPECT / max(rows - 1, 2), 0.01)


def _middle(places: Iterable[tuple[float, float]]) -> tuple[float, float]:
    places = list(places)
    xs, ys = [x for x, _ in places], [y for _, y in places]
    return (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2


def _draw_line(cells: list[list[str]], one: tuple[int, int], other: tuple[int, int], mark: str) -> None:
    steps = max(abs(other[0] - one[0]), abs(other[1] - one[1]))
    for step in range(1, steps):
        column = round(one[0] + (other[0] - one[0]) * step / steps)
        row = round(one[1] + (other[1] - one[1]) * step / steps)
        # a line never covers a mark or an earlier line, so that all nodes stay visible
        if cells[row][column] == " ":
            cells[row][column] = mark


def _write_name(row: list[str], column: int, name: str) -> None:
    """The name right of its node, else left of it, where it covers no node and no other name."""
    for begin in (column + 1, column - len(name)):
        end = begin + len(name)
        if begin >= 0 and end <= len(row) and all(cell in (" ", LINK, ONE_WAY) for cell in row[begin:end]):
            row[begin:end] = name
            return


def _round_length_m(length_m: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 1.0
    while power * 10 <= length_m:
        power *= 10
    while power > length_m:
        power /= 10
    return max(factor * power for factor in (1, 2, 5) if factor * power <= length_m or factor == 1)
