"""Radio files of this installation or of the user, and the recorded links that they name."""

import csv
import io
import math
from pathlib import Path
from typing import Final

import msgspec

from swarmlab.radio.core.model import RadioModel, TracePoint
from swarmware.errors import ConfigError, NotFound
from swarmware.model import document
from swarmware.model.config import load, share_dir
from swarmware.model.explanation import explain

SUFFIX: Final = ".toml"
COLUMNS: Final = TracePoint.__struct_fields__


def find_radio(name: str) -> Path:
    """Path of a radio file: a path as given, or a name of this installation.

    Raises: NotFound naming the known ones.
    """
    folder = share_dir() / "radios"
    path = Path(name).resolve() if "/" in name or name.endswith(SUFFIX) else folder / f"{name}{SUFFIX}"
    if not path.is_file():
        known = ", ".join(sorted(found.stem for found in folder.glob(f"*{SUFFIX}")))
        raise NotFound(f"--radio {name}: {path}: no such file; expected one of {known}, or a path")
    return path


def load_radio(path: Path) -> tuple[RadioModel, tuple[TracePoint, ...]]:
    """A radio file, and the rows of the recorded link that it names.

    Raises: ConfigError with file, line or key, and the expected value.
    """
    model = load(path, RadioModel)
    return model, () if model.trace is None else _rows(path.parent / model.trace.file)


def _rows(path: Path) -> tuple[TracePoint, ...]:
    try:
        text = document.read(path)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; expected a recorded link as CSV") from None
    reader = csv.reader(io.StringIO(text))
    if (head := tuple(next(reader, ()))) != COLUMNS:
        raise _refusal(path, 1, f"columns {','.join(head)}; expected {','.join(COLUMNS)}")
    rows: list[TracePoint] = []
    for values in reader:
        if len(values) != len(COLUMNS):
            raise _refusal(path, reader.line_num, f"{len(values)} values; expected {len(COLUMNS)}")
        row = _row(path, reader.line_num, values)
        if rows and row.time_s < rows[-1].time_s:
            text = f"time_s {row.time_s:g} after {rows[-1].time_s:g}; expected ascending times"
            raise _refusal(path, reader.line_num, text)
        rows.append(row)
    if not rows:
        raise _refusal(path, 1, "no rows; expected at least one")
    return tuple(rows)


def _row(path: Path, line: int, values: list[str]) -> TracePoint:
    numbers = {}
    for name, value in zip(COLUMNS, values, strict=True):
        try:
            numbers[name] = float(value)
        except ValueError:
            raise _refusal(path, line, f"{name}: {value!r}; expected a number") from None
        # `float` accepts nan and inf, which no check of a range refuses
        if not math.isfinite(numbers[name]):
            raise _refusal(path, line, f"{name}: {value!r}; expected a finite number")
    try:
        return msgspec.convert(numbers, TracePoint)
    except msgspec.ValidationError as error:
        found = explain(str(error), numbers, TracePoint)
        raise _refusal(path, line, found.text) from error


def _refusal(path: Path, line: int, text: str) -> ConfigError:
    return ConfigError(text, source=str(path), line=line)
