"""One table as a CSV or Parquet file, written while it is read."""

import csv
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, Final, Protocol, TextIO

from swarmctl.commands.log.columns import HEAD, ColumnKind, Content, TableColumn, exact, text
from swarmctl.terminal.quantities import utc_text
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import missing_extra
from swarmware.model.visible import visible
from swarmware.recorder.entry import LogEntry

ROWS: Final = 1 << 14
"""Maximum number of rows of a row group, which is held in memory."""
_INT: Final = Content(ColumnKind.INT)
_TEXT: Final = Content(ColumnKind.TEXT)
_RANGES: Final = {ColumnKind.INT: (-(1 << 63), (1 << 63) - 1), ColumnKind.UINT: (0, (1 << 64) - 1)}


class TableWriter(Protocol):
    """A table that grows by rows."""

    def add(self, entry: LogEntry, cells: Sequence[Any]) -> None:
        """Append the row of an entry."""
        ...

    def flush(self) -> None:
        """Write the rows that are held in memory."""
        ...

    def close(self) -> None:
        """Write the rest and end the file."""
        ...


def _converted(convert: Callable[..., Any], *value: Any, name: str, lost: LostValues) -> Any:
    """A cell in the form of the file; None, and counted, if it is nested too deep for the interpreter."""
    try:
        return convert(*value)
    except RecursionError:
        lost.add(f"{name}, nested too deep")
        return None


class CsvWriter:
    """A table as CSV."""

    def __init__(
        self,
        file: TextIO,
        columns: Sequence[TableColumn],
        name: str,
        lost: LostValues,
        *,
        shown: bool = False,
    ) -> None:
        """`name`: of the type, for the reasons of lost values. `shown`: on a terminal."""
        self._file = file
        self._shown = shown
        self._name = name
        self._lost = lost
        # files end their lines by CR LF (RFC 4180), a terminal needs LF alone
        self._rows = csv.writer(file, lineterminator="\n" if shown else "\r\n")
        self._write([*HEAD, *(column.name for column in columns)])
        self._changed = [
            place
            for place, column in enumerate(columns, start=len(HEAD))
            # bytes have the type of their column, but CSV needs them as base64
            if not column.content.raw or column.content.kind is ColumnKind.BYTES
        ]

    def add(self, entry: LogEntry, cells: Sequence[Any]) -> None:
        """Append the row of an entry."""
        head = [utc_text(entry.utc_ns), entry.utc_ns, entry.stamp_ns, entry.topic, entry.sender]
        row = [*head, *cells]
        for place in self._changed:
            row[place] = _converted(text, row[place], name=self._name, lost=self._lost)
        self._write(row)

    def _write(self, row: Sequence[Any]) -> None:
        # a terminal would obey control characters
        self._rows.writerow(
            [visible(one) if isinstance(one, str) else one for one in row] if self._shown else row
        )

    def flush(self) -> None:
        """Write the rows that are held in memory."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest; the file stays open."""
        self.flush()


class ParquetWriter:
    """A table as Parquet, in groups of rows."""

    def __init__(self, file: BinaryIO, columns: Sequence[TableColumn], name: str, lost: LostValues) -> None:
        """`name`: of the type, for the reasons of lost values.

        Raises: ConfigError when pyarrow is not installed.
        """
        self._pyarrow = pyarrow = _pyarrow()
        from pyarrow import parquet

        self._name = name
        self._lost = lost
        self._contents = [_INT, _INT, _INT, _TEXT, _TEXT, *(column.content for column in columns)]
        self._names = [*HEAD, *(column.name for column in columns)]
        types = [pyarrow.timestamp("ns", "UTC"), *(_type(pyarrow, one) for one in self._contents[1:])]
        self._schema = pyarrow.schema(list(zip(self._names, types, strict=True)))
        self._writer = parquet.ParquetWriter(file, self._schema)
        self._rows: list[list[Any]] = []
        places = range(len(HEAD), len(self._contents))
        self._changed = [(one, self._contents[one]) for one in places if not self._contents[one].raw]

    def add(self, entry: LogEntry, cells: Sequence[Any]) -> None:
        """Append the row of an entry."""
        row = [entry.utc_ns, entry.utc_ns, entry.stamp_ns, entry.topic, entry.sender, *cells]
        for place, content in self._changed:
            row[place] = _converted(exact, row[place], content, name=self._name, lost=self._lost)
        self._rows.append(row)
        if len(self._rows) >= ROWS:
            self.flush()

    def flush(self) -> None:
        """Write the rows that are held in memory as one group."""
        if self._rows:
            columns = zip(*self._rows, strict=True)
            arrays = [self._array(place, values) for place, values in enumerate(columns)]
            self._rows = []
            self._writer.write_table(self._pyarrow.Table.from_arrays(arrays, schema=self._schema))

    def _array(self, place: int, values: Sequence[Any]) -> Any:
        kind = self._schema.field(place).type
        try:
            return self._pyarrow.array(values, kind)
        # a value is out of range: found only now, since a check of each value would slow every export
        except (OverflowError, self._pyarrow.ArrowInvalid):
            content = self._contents[place]
            return self._pyarrow.array([self._in_range(value, content, place) for value in values], kind)

    def _in_range(self, value: Any, content: Content, place: int) -> Any:
        """A value without the integers that the column cannot hold: they are null, and counted."""
        if content.kind is ColumnKind.LIST and content.item is not None and value is not None:
            return [self._in_range(item, content.item, place) for item in value]
        if content.kind is ColumnKind.RECORD and value is not None:
            return {name: self._in_range(value[name], one, place) for name, _, one in content.fields}
        low, high = _RANGES.get(content.kind, (None, None))
        if value is None or low is None or high is None or low <= value <= high:
            return value
        sign = "without" if content.kind is ColumnKind.UINT else "with"
        self._lost.add(f"{self._name}, column {self._names[place]}, beyond 64 bits {sign} sign")
        return None

    def close(self) -> None:
        """Write the rest and end the file."""
        try:
            self.flush()
        finally:
            # also after an error, or the file would stay open
            self._writer.close()


def _type(pyarrow: Any, content: Content) -> Any:
    """Type of a column in Arrow."""
    match content.kind:
        case ColumnKind.BOOL:
            return pyarrow.bool_()
        case ColumnKind.INT:
            return pyarrow.int64()
        case ColumnKind.UINT:
            return pyarrow.uint64()
        case ColumnKind.FLOAT:
            return pyarrow.float64()
        case ColumnKind.BYTES:
            return pyarrow.binary()
        case ColumnKind.LIST if content.item is not None:
            return pyarrow.list_(_type(pyarrow, content.item))
        case ColumnKind.RECORD:
            return pyarrow.struct([(name, _type(pyarrow, one)) for name, _, one in content.fields])
    return pyarrow.string()


def _pyarrow() -> Any:
    try:
        import pyarrow
    except ImportError as error:
        raise missing_extra("log export --format parquet", error, "parquet") from error
    return pyarrow


def check_parquet() -> None:
    """Check that Parquet can be written.

    Raises: ConfigError when pyarrow is not installed.
    """
    _pyarrow()
