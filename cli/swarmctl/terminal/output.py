"""Output of a command: results on stdout as table or JSON, messages on stderr."""

import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Final, TextIO

import msgspec

from swarmctl.commandline.settings import CliSettings

SCHEMA_VERSION: Final = 1
"""Version of the JSON documents; it increases when a key changes its meaning or is removed."""

Cell = str | int | float | bool | None


class Column(msgspec.Struct, frozen=True):
    """A column of a table."""

    name: str
    right: bool = False
    """Aligned to the right, for numbers."""


class Output:
    """The two streams of a command and the rules for them.

    A table is drawn with colours on a terminal, and plain, complete and never cut short elsewhere.
    """

    def __init__(
        self, settings: CliSettings, stdout: TextIO | None = None, stderr: TextIO | None = None
    ) -> None:
        self.settings = settings
        self._out = stdout or sys.stdout
        self._err = stderr or sys.stderr

    @property
    def fancy(self) -> bool:
        """Whether stdout is a terminal with colours."""
        return self._out.isatty() and self.colors

    @property
    def lively(self) -> bool:
        """Whether stderr is a terminal that can show a progress bar."""
        return self._err.isatty() and not self.settings.quiet

    @property
    def colors(self) -> bool:
        """Whether colours are allowed (NO_COLOR, --no-color, TERM=dumb)."""
        forbidden = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        return not (forbidden or self.settings.no_color)

    def say(self, text: str) -> None:
        """Print a message about progress, unless --quiet is given."""
        if not self.settings.quiet:
            print(text, file=self._err, flush=True)

    def detail(self, text: str) -> None:
        """Print a message if --verbose is given."""
        if self.settings.verbose:
            print(text, file=self._err, flush=True)

    def warn(self, text: str) -> None:
        """Print a warning, also with --quiet."""
        print(f"warning: {text}", file=self._err, flush=True)

    def text(self, text: str) -> None:
        """Print a result that is text."""
        print(text, file=self._out)

    def now(self, text: str) -> None:
        """Print one line of a continuous result, flushed because a reader may follow it."""
        print(text, file=self._out, flush=True)

    def table(self, columns: Sequence[Column], rows: Sequence[Sequence[Cell]], title: str = "") -> None:
        """Print a result as a table."""
        cells = [[show(cell) for cell in row] for row in rows]
        if not self.fancy:
            self.text(plain_table(columns, cells, title))
            return
        from rich.console import Console
        from rich.table import Table
        from rich.text import Text

        drawn = Table(
            title=title or None, title_justify="left", header_style="bold", box=None, pad_edge=False
        )
        for column in columns:
            drawn.add_column(column.name, justify="right" if column.right else "left", overflow="fold")
        for row in cells:
            drawn.add_row(*(Text(cell) for cell in row))
        Console(file=self._out, highlight=False).print(drawn)

    def document(self, value: Any) -> None:
        """Print a JSON document: the version of the schema, then the fields of a Struct or dict."""
        self.exact({"schema_version": SCHEMA_VERSION, **named(value)})

    def exact(self, value: Any) -> None:
        """Print a JSON document with exactly these keys."""
        data = msgspec.json.format(msgspec.json.encode(value), indent=2)
        self.text(data.decode())

    def line(self, value: Any) -> None:
        """Print one line of JSON Lines, flushed because a reader may follow it."""
        print(msgspec.json.encode(named(value)).decode(), file=self._out, flush=True)


def named(value: Any) -> Any:
    """A value with every Struct in it as its fields by name, including those encoded as arrays."""
    if isinstance(value, msgspec.Struct):
        keys = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        return {key: named(getattr(value, field)) for key, field in keys}
    if isinstance(value, Mapping):
        return {str(key): named(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [named(item) for item in value]
    return value


def show(cell: Cell) -> str:
    """Text of a value: a dash for no value, numbers with four significant digits."""
    if cell is None or cell == "":
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return f"{cell:.4g}" if abs(cell) < 1e4 else f"{cell:.0f}"
    return str(cell)


def plain_table(columns: Sequence[Column], cells: Sequence[Sequence[str]], title: str = "") -> str:
    """The table as text: two blanks between columns, nothing truncated."""
    widths = [max([len(c.name), *(len(row[i]) for row in cells)]) for i, c in enumerate(columns)]
    lines = [title] if title else []
    for row in [[c.name for c in columns], *cells]:
        padded = [
            text.rjust(width) if column.right else text.ljust(width)
            for text, width, column in zip(row, widths, columns, strict=True)
        ]
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)
