"""Tables of commands, fitted to the width of a terminal without breaking a word."""

from collections.abc import Callable, Iterable, Sequence
from typing import Final, Generic, TypeVar

import msgspec

from swarmctl.terminal.wrapping import atoms, words, wrapped
from swarmware.model.visible import visible

Cell = str | int | float | bool | None
T = TypeVar("T")

GAP: Final = "  "
"""Space between two columns."""
PADDED: Final = 60
"""Widest cell to which the others of its column are padded outside of a terminal: a longer one moves the rest
of its own line alone."""
WRAPPED: Final = 16
"""Width of a column of texts that is still readable."""


class Column(msgspec.Struct, frozen=True):
    """A column of a table."""

    name: str
    right: bool = False
    """Aligned to the right, for numbers."""
    wide: bool = False
    """Shown with `-o wide` only."""
    drop: int = 0
    """Order in which columns are hidden on a narrow terminal, the highest first, or 0 for never."""
    wraps: bool = False
    """Whether texts are wrapped before another column is hidden."""


class Detail(Column, Generic[T], frozen=True, kw_only=True):
    """A column with its cell of each listed item."""

    value: Callable[[T], Cell]


def rows_of(details: Sequence[Detail[T]], items: Iterable[T]) -> list[tuple[Cell, ...]]:
    """The rows of a table, one for each item."""
    return [tuple(detail.value(item) for detail in details) for item in items]


class FittedTable(msgspec.Struct, frozen=True):
    """A table as lines of text."""

    header: list[str]
    rows: list[str]
    hidden: list[str]
    """Names of the columns that have no place at this width."""

    @property
    def text(self) -> str:
        """The header and the rows below it."""
        return "\n".join([*self.header, *self.rows])


def show(cell: Cell) -> str:
    """Text of a value: a dash for no value, numbers with four significant digits."""
    if cell is None or cell == "":
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return f"{cell:.4g}" if abs(cell) < 1e4 else f"{cell:.0f}"
    return str(cell)


def fitted_table(
    columns: Sequence[Column], cells: Sequence[Sequence[str]], width: int | None = None
) -> FittedTable:
    """The table within `width` characters, or with nothing wrapped or hidden if `width` is None.

    What is too wide gives way in this order: headers are wrapped, columns are hidden by their `drop`,
    cells are wrapped between words, cells are wrapped after the punctuation of paths and lists. A table
    that is too wide even then is a record per row, if that helps. A word is never broken. Control characters
    of cells are shown as escape sequences.
    """
    cells = [[visible(text) for text in row] for row in cells]
    places = list(range(len(columns)))
    widths = _unwrapped(columns, cells, places, width)
    while (
        width is not None
        and _required(columns, cells, places, widths) > width
        and any(columns[place].drop for place in places)
    ):
        places.remove(max(places, key=lambda place: columns[place].drop))
        widths = _unwrapped(columns, cells, places, width)
    if width is not None:
        for parts in (words, atoms):
            widths = _narrowed(widths, _widest(columns, cells, places, parts), width)
    if width is not None and _total(widths) > width:
        records = _records(columns, cells, width)
        # records that are too wide as well would lose the columns for nothing
        if all(len(line) <= width for line in records.rows):
            return records
    kept = [columns[place] for place in places]
    wraps = width is not None
    return FittedTable(
        header=_drawn(kept, [column.name for column in kept], widths, wraps=wraps),
        rows=[
            line
            for row in cells
            for line in _drawn(kept, [row[place] for place in places], widths, wraps=wraps)
        ],
        hidden=[column.name for place, column in enumerate(columns) if place not in places],
    )


def _records(columns: Sequence[Column], cells: Sequence[Sequence[str]], width: int) -> FittedTable:
    """A line for each column of a row, its name before the value; records are separated by empty lines."""
    label = max(len(column.name) for column in columns)
    if label + len(GAP) > width // 2:
        label = 0  # the name has no place beside the value
    lines: list[str] = []
    for number, row in enumerate(cells):
        lines += [""] if number else []
        for column, text in zip(columns, row, strict=True):
            head = f"{column.name:<{label}}{GAP}"
            lines += wrapped(text, width, head, " " * (label + len(GAP)))
    return FittedTable([], lines, [])


def _required(
    columns: Sequence[Column], cells: Sequence[Sequence[str]], places: Sequence[int], widths: Sequence[int]
) -> int:
    """Width of the table when only the cells of columns that wrap are wrapped."""
    floors = _widest(
        columns, cells, places, lambda text: [part for word in words(text) for part in atoms(word)]
    )
    return _total(
        [
            min(one, max(floor, WRAPPED)) if columns[place].wraps else one
            for one, floor, place in zip(widths, floors, places, strict=True)
        ]
    )


def _unwrapped(
    columns: Sequence[Column], cells: Sequence[Sequence[str]], places: Sequence[int], width: int | None
) -> list[int]:
    """Widths without wrapping a cell; headers are wrapped where `width` requires it."""
    if width is None:
        return [
            # the 0 is a second argument for `max` when no cell is left
            max(len(columns[place].name), *(len(row[place]) for row in cells if len(row[place]) <= PADDED), 0)
            for place in places
        ]
    whole = _widest(columns, cells, places, lambda text: [text])
    widths = [max(one, len(columns[place].name)) for one, place in zip(whole, places, strict=True)]
    return _narrowed(widths, whole, width)


def _widest(
    columns: Sequence[Column],
    cells: Sequence[Sequence[str]],
    places: Sequence[int],
    parts: Callable[[str], list[str]],
) -> list[int]:
    """Per column the longest part of its cells or word of its header."""
    return [
        max(len(part) for text in texts for part in text)
        for texts in ([words(columns[place].name), *(parts(row[place]) for row in cells)] for place in places)
    ]


def _narrowed(widths: Sequence[int], floor: Sequence[int], width: int) -> list[int]:
    """Widths reduced, the widest first and none below its floor, until the table fits in `width`."""
    widths = list(widths)
    while _total(widths) > width:
        able = [place for place in range(len(widths)) if widths[place] > floor[place]]
        if not able:
            break
        widths[max(able, key=lambda place: widths[place])] -= 1
    return widths


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _drawn(
    columns: Sequence[Column], texts: Sequence[str], widths: Sequence[int], *, wraps: bool
) -> list[str]:
    """One row of the table, as many lines as its highest cell."""
    cells = [wrapped(text, width if wraps else None) for text, width in zip(texts, widths, strict=True)]
    lines = []
    for number in range(max(map(len, cells), default=0)):
        parts = [cell[number] if number < len(cell) else "" for cell in cells]
        padded = [
            part.rjust(width) if column.right else part.ljust(width)
            for part, width, column in zip(parts, widths, columns, strict=True)
        ]
        lines.append(GAP.join(padded).rstrip())
    return lines
