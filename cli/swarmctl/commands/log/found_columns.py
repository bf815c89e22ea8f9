"""Columns of values whose type is unknown here: by the keys and values that were found."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec

from swarmctl.commands.log.columns import VALUE, ColumnKind, Content, TableColumn, named

COLUMNS_LIMIT: Final = 1000
"""More keys than this are data, not fields: each value is one cell then."""
_DEPTH_LIMIT: Final = 16
"""Maps in maps that become columns; deeper ones are a cell."""
_EXACT: Final = 1 << 53
_KINDS: Final = {
    bool: ColumnKind.BOOL,
    int: ColumnKind.INT,
    float: ColumnKind.FLOAT,
    str: ColumnKind.TEXT,
    bytes: ColumnKind.BYTES,
}

Path = tuple[Any, ...]


class _Seen(msgspec.Struct):
    """Values of one key so far."""

    kinds: set[ColumnKind]
    low: int = 0
    high: int = 0

    def content(self) -> Content:
        # integers up to 2^53 are exact as a float; larger ones keep their digits as JSON
        if self.kinds == {ColumnKind.INT, ColumnKind.FLOAT} and max(-self.low, self.high) <= _EXACT:
            return Content(ColumnKind.FLOAT)
        if len(self.kinds) != 1:
            return Content(ColumnKind.JSON)
        (kind,) = self.kinds
        # no integer type of a table holds negative and such large numbers
        if kind is ColumnKind.INT and self.high >= 1 << 63:
            return Content(ColumnKind.JSON) if self.low < 0 else Content(ColumnKind.UINT, raw=True)
        return Content(kind, raw=kind is not ColumnKind.JSON)


class FoundColumns:
    """Columns for all values that `add` has taken."""

    def __init__(self) -> None:
        self._seen: dict[Path, _Seen] = {}

    def add(self, value: Any) -> None:
        """Take a value into account."""
        if len(self._seen) > COLUMNS_LIMIT:
            return
        for path, leaf in _leaves(value, ()):
            seen = self._seen.setdefault(path, _Seen(set()))
            if leaf is not None:
                seen.kinds.add(_KINDS.get(type(leaf), ColumnKind.JSON))
            if type(leaf) is int:
                seen.low, seen.high = min(seen.low, leaf), max(seen.high, leaf)

    def columns(self) -> list[TableColumn]:
        """Columns of the table."""
        if len(self._seen) > COLUMNS_LIMIT:
            return [TableColumn(VALUE, (), Content(ColumnKind.JSON))]
        return named((".".join(map(str, path)), path, seen.content()) for path, seen in self._seen.items())

    def cells(self, value: Any) -> list[Any]:
        """Values of the columns."""
        if len(self._seen) > COLUMNS_LIMIT:
            return [value]
        leaves = dict(_leaves(value, ()))
        return [leaves.get(path) for path in self._seen]


def _leaves(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    """Values that are not maps, with their keys."""
    # an empty map stays a value: without a column it would look like a missing one
    if isinstance(value, Mapping) and value and len(path) < _DEPTH_LIMIT:
        for key, item in value.items():
            yield from _leaves(item, (*path, key))
    else:
        yield path, value
