"""Entries as tables, one a type: CSV or Parquet."""

import re
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, Final, TextIO, cast

from swarmctl.commands.log.columns import TableColumn, cells_of, columns_of
from swarmctl.commands.log.found_columns import FoundColumns
from swarmctl.commands.log.table_writers import CsvWriter, ParquetWriter, TableWriter, check_parquet
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import InvalidInput, NotFound
from swarmware.recorder import spool
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import Query
from swarmware.runtime.filewriter import naming

TABLES_LIMIT: Final = 200
"""Tables of one export: each is an open file."""
PENDING_BYTES: Final = 16 << 20
"""Payload of the rows in memory, of all tables: about 100 MB as Python objects."""
_ROW_BYTES: Final = 64
"""What a row costs besides its payload."""
_PART: Final = ".part"
"""Suffix of a file that is not complete."""
_NAME: Final = re.compile(r"\w[\w-]*(?:\.[\w-]+)*", re.ASCII)
_NAME_BYTES: Final = 100
_RESERVED: Final = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\.|\Z)", re.IGNORECASE)
"""Names of devices. Source: Microsoft, "Naming Files, Paths, and Namespaces"."""


def write_tables(entries: Iterable[LogEntry], form: str, target: str, lost: LostValues | None = None) -> int:
    """Writes one type to a file, several to a folder with one file each; the number of entries.

    Raises: InvalidInput for several types and the name of a file; NotFound without the folder of the file;
    ConfigError when an extra is missing.
    """
    if form == "parquet":
        if target == "-":
            raise InvalidInput("--out -: Parquet is not written to a stream; expected a file or a folder")
        check_parquet()
    count = 0
    with naming(target), ExitStack() as stack:
        tables = Tables(form, target, LostValues() if lost is None else lost, stack)
        for entry in entries:
            tables.add(entry)
            count += 1
        tables.finish()
    return count


class KnownTable:
    """Rows of one type whose fields are known: written as they come."""

    def __init__(self, name: str, columns: list[TableColumn], writer: TableWriter, path: Path) -> None:
        self.name = name
        self.path = path
        self._cells = cells_of(columns)
        self._writer = writer

    def add(self, entry: LogEntry, value: Any) -> None:
        """Append the row of an entry."""
        self._writer.add(entry, self._cells(value))

    def flush(self) -> None:
        """Write the rows that are held in memory."""
        self._writer.flush()

    def close(self) -> None:
        """Write the end of the file."""
        self._writer.close()


class KeptTable:
    """Rows in a temporary file: their columns, or whether they are written at all, is known at the end."""

    def __init__(self, name: str, columns: list[TableColumn] | None, file: BinaryIO) -> None:
        """`columns`: None for a type that is unknown here."""
        self.name = name
        self._columns = columns
        self._found = FoundColumns()
        self._file = file

    def add(self, entry: LogEntry, value: Any) -> None:
        """Keep an entry for the end."""
        spool.write((entry,), self._file)
        if self._columns is None:
            self._found.add(value)

    def flush(self) -> None:
        """Nothing is held in memory."""

    @property
    def columns(self) -> list[TableColumn]:
        """Columns of the table, when all entries are kept."""
        return self._found.columns() if self._columns is None else self._columns

    def rows(self) -> Iterator[tuple[LogEntry, Sequence[Any]]]:
        """The entries and their cells."""
        cells = self._found.cells if self._columns is None else cells_of(self._columns)
        self._file.seek(0)
        for entry in spool.SpoolSource(self._file, self.name).entries(Query()):
            yield entry, cells(entry.content())


class Tables:
    """The tables of one export, in a folder or in one file."""

    def __init__(self, form: str, target: str, lost: LostValues, stack: ExitStack) -> None:
        """`stack`: closes and removes what is not complete."""
        self._form = form
        self._target = target
        self._lost = lost
        self._stack = stack
        self._tables: dict[tuple[str, type | None], KnownTable | KeptTable] = {}
        self._pending = 0
        path = Path(target)
        self._folder = path if target != "-" and (path.is_dir() or target.endswith("/")) else None
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
        elif target != "-" and not path.parent.is_dir():
            raise NotFound(f"--out {target}: no folder {path.parent}; expected an existing one")
        self._direct = target == "-" or (path.exists() and not path.is_file())
        """Whether the target is a stream or a device, which no complete file can replace."""

    def add(self, entry: LogEntry) -> None:
        """Append the row of an entry to the table of its type."""
        value = entry.value()
        key = entry.type or "unknown", None if value is None else type(value)
        table = self._tables.get(key)
        if table is None:
            table = self._tables[key] = self._made(*key)
        if len(self._tables) > 1 and self._folder is None:
            return  # refused at the end, with the names of all types
        table.add(entry, entry.content() if value is None else value)
        # counted over all tables: many types with few rows each would otherwise fill the memory
        self._pending += _ROW_BYTES + len(entry.payload)
        if self._pending >= PENDING_BYTES:
            self._pending = 0
            for one in self._tables.values():
                one.flush()

    def _made(self, name: str, cls: type | None) -> KnownTable | KeptTable:
        if len(self._tables) >= TABLES_LIMIT:
            raise InvalidInput(f"--out {self._target}: more than {TABLES_LIMIT} types; expected --type TYPE")
        columns = None if cls is None else columns_of(cls)
        # a stream cannot be taken back, so it is written only when it is certain that there is a single
        # type
        if columns is None or (self._direct and self._folder is None) or self._refused():
            return KeptTable(
                name, columns, cast(BinaryIO, self._stack.enter_context(tempfile.TemporaryFile()))
            )
        path = self._part(name)
        writer = self._writer(str(path), name, columns)
        return KnownTable(name, columns, writer, path)

    def _refused(self) -> bool:
        return self._folder is None and bool(self._tables)

    def _part(self, name: str) -> Path:
        """A new file for an incomplete table; removed if it stays so."""
        wanted = (
            Path(self._target) if self._folder is None else self._folder / f"{safe_name(name)}.{self._form}"
        )
        path, number = Path(f"{wanted}{_PART}"), 1
        taken = {one.path for one in self._tables.values() if isinstance(one, KnownTable)}
        while path in taken:
            number += 1
            path = Path(f"{wanted}_{number}{_PART}")
        # a complete file has its final name by then, so this removes only incomplete ones
        self._stack.callback(path.unlink, missing_ok=True)
        return path

    def _writer(self, path: str, name: str, columns: list[TableColumn]) -> TableWriter:
        writer: TableWriter
        if self._form == "parquet":
            # opened here: the library's error does not name the file
            binary = self._stack.enter_context(_binary_file(path))
            writer = ParquetWriter(binary, columns, name, self._lost)
        else:
            stdout = path == "-"
            file = sys.stdout if stdout else self._stack.enter_context(_text_file(path))
            terminal = stdout and sys.stdout.isatty()
            writer = CsvWriter(file, columns, name, self._lost, shown=terminal)
        self._stack.callback(writer.close)
        return writer

    def finish(self) -> None:
        """End the files, and give them their names.

        Raises: InvalidInput for several types and the name of a file.
        """
        if self._folder is None and len(self._tables) > 1:
            names = sorted(name for name, _ in self._tables)
            shown = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
            raise InvalidInput(
                f"--out {self._target}: {len(names)} tables of a type each ({shown}); expected --type TYPE,"
                " or a folder: --out FOLDER/"
            )
        for table, target in self._named():
            if isinstance(table, KeptTable):
                path = Path(target) if self._direct and self._folder is None else self._part(table.name)
                self._write_kept(table, target if target == "-" else str(path))
            else:
                table.close()
                path = table.path
            if target != "-" and str(path) != target:
                path.replace(target)

    def _write_kept(self, table: KeptTable, path: str) -> None:
        writer = self._writer(path, table.name, table.columns)
        pending = 0
        for entry, cells in table.rows():
            writer.add(entry, cells)
            pending += _ROW_BYTES + len(entry.payload)
            if pending >= PENDING_BYTES:
                writer.flush()
                pending = 0
        writer.close()

    def _named(self) -> Iterator[tuple[KnownTable | KeptTable, str]]:
        """The tables and the names of their files; types whose names are file names keep these."""
        keys = sorted(self._tables, key=lambda key: (safe_name(key[0]) != key[0], key[0], key[1] is None))
        taken: set[str] = set()
        for key in keys:
            if self._folder is None:
                yield self._tables[key], self._target
                continue
            wanted = name = safe_name(key[0])
            number = 1
            # file systems of Windows and macOS do not distinguish upper and lower case
            while name.casefold() in taken:
                number += 1
                name = f"{wanted}_{number}"
            taken.add(name.casefold())
            yield self._tables[key], str(self._folder / f"{name}.{self._form}")


def _binary_file(path: str) -> BinaryIO:
    return Path(path).open("wb")


def _text_file(path: str) -> TextIO:
    return Path(path).open("w", encoding="utf-8", newline="")


def safe_name(type_name: str) -> str:
    """Name of a file for a type, which comes from the log: never a path, a device or a hidden file."""
    name = "_".join(_NAME.findall(type_name))[:_NAME_BYTES].rstrip(".-") or "unknown"
    return f"_{name}" if _RESERVED.match(name) else name
