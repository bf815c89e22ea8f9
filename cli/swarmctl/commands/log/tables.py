"""Entries as tables, one a type: CSV or Parquet."""

import csv
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from swarmctl.terminal.quantities import utc_text
from swarmware.errors import InvalidInput, missing_extra
from swarmware.recorder.entry import LogEntry

_HEAD: Final = ("utc", "utc_ns", "stamp_ns", "path", "sender")


class Table:
    """Rows of one type: its columns are the fields, nested ones with dots."""

    def __init__(self) -> None:
        self._entries: list[tuple[LogEntry, dict[str, Any]]] = []
        self._fields: dict[str, None] = {}

    def add(self, entry: LogEntry) -> None:
        """Append the row of an entry."""
        fields = dict(_flat("", entry.plain()))
        self._fields |= dict.fromkeys(fields)
        self._entries.append((entry, fields))

    def write_csv(self, target: str) -> None:
        """Write the table to a file, or `-` for stdout."""
        if target == "-":
            self._write_rows(sys.stdout)
            return
        with Path(target).open("w", encoding="utf-8", newline="") as file:
            self._write_rows(file)

    def _write_rows(self, file: Any) -> None:
        writer = csv.writer(file)
        writer.writerow([*_HEAD, *map(_column, self._fields)])
        for entry, fields in self._entries:
            head = [utc_text(entry.utc_ns), entry.utc_ns, entry.stamp_ns, entry.topic, entry.sender]
            writer.writerow([*head, *(fields.get(field, "") for field in self._fields)])

    def write_parquet(self, target: str) -> None:
        """Write the table to a file.

        Raises: ConfigError when pyarrow is not installed.
        """
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError as error:
            raise missing_extra("log export --format parquet", error, "parquet") from error
        entries = [entry for entry, _ in self._entries]
        columns: dict[str, Any] = {
            "utc": pyarrow.array([entry.utc_ns for entry in entries], pyarrow.timestamp("ns", "UTC")),
            "utc_ns": pyarrow.array([entry.utc_ns for entry in entries], pyarrow.int64()),
            "stamp_ns": pyarrow.array([entry.stamp_ns for entry in entries], pyarrow.int64()),
            "path": pyarrow.array([entry.topic for entry in entries], pyarrow.string()),
            "sender": pyarrow.array([entry.sender for entry in entries], pyarrow.string()),
        }
        for field in self._fields:
            columns[_column(field)] = _typed(pyarrow, [fields.get(field) for _, fields in self._entries])
        parquet.write_table(pyarrow.table(columns), target)


def _typed(pyarrow: Any, values: list[Any]) -> Any:
    """A column; as text when its values have several types, or are beyond 64 bits."""
    try:
        return pyarrow.array(values)
    except (pyarrow.ArrowException, OverflowError):
        return pyarrow.array([None if value is None else str(value) for value in values], pyarrow.string())


def _column(field: str) -> str:
    """Name of a field's column; a field with the name of a column of every table has a prefix."""
    return f"value.{field}" if field in _HEAD else field


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{prefix}.{key}" if prefix else key, item)
    elif isinstance(value, list):
        yield prefix or "value", msgspec.json.encode(value).decode()
    else:
        yield prefix or "value", value


def write_tables(entries: Iterable[LogEntry], form: str, target: str) -> int:
    """Writes one type to a file, several to a folder with one file each; the number of entries.

    Raises: InvalidInput for several types and the name of a file; ConfigError when an extra is missing.
    """
    tables: dict[str, Table] = {}
    count = 0
    for entry in entries:
        tables.setdefault(entry.type or "unknown", Table()).add(entry)
        count += 1
    targets = _targets(sorted(tables), form, target)
    for name, path in targets.items():
        if form == "csv":
            tables[name].write_csv(path)
        else:
            tables[name].write_parquet(path)
    return count


def _targets(types: list[str], form: str, target: str) -> dict[str, str]:
    folder = Path(target)
    if form == "parquet" and target == "-":
        raise InvalidInput("--out -: Parquet is not written to a stream; expected a file or a folder")
    if target != "-" and (folder.is_dir() or target.endswith("/")):
        folder.mkdir(parents=True, exist_ok=True)
        return {name: str(folder / f"{name}.{form}") for name in types}
    if len(types) > 1:
        raise InvalidInput(
            f"--out {target}: {len(types)} tables of a type each ({', '.join(types)}); expected --type TYPE,"
            " or a folder: --out FOLDER/"
        )
    return dict.fromkeys(types, target)
