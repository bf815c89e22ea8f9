"""Output of a command: results on stdout as table or JSON, messages on stderr."""

import os
import sys
from collections.abc import Sequence
from typing import Any, Final, TextIO

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.terminal.size import terminal_columns, terminal_lines
from swarmctl.terminal.table import Cell, Column, fitted_table, show
from swarmctl.terminal.wrapping import clipped, fitted_text, terminal_width
from swarmware.model.visible import HIDDEN, json_escaped, visible, visible_lines
from swarmware.types.json_form import json_form

SCHEMA_VERSION: Final = 2
"""Version of the JSON documents; it increases when a key changes its meaning or is removed."""


class Output:
    """The two streams of a command and the rules for them.

    Tables and texts are fitted to the width of a terminal; elsewhere they are as wide as they are.
    """

    def __init__(
        self, settings: CliSettings, stdout: TextIO | None = None, stderr: TextIO | None = None
    ) -> None:
        self.settings = settings
        self._out = stdout or sys.stdout
        self._err = stderr or sys.stderr
        self._redrawn = 0
        """Lines of the last redrawn text."""

    @property
    def fancy(self) -> bool:
        """Whether stdout is a terminal with colours."""
        return self._out.isatty() and self.colors

    @property
    def redraws(self) -> bool:
        """Whether stdout is a terminal on which a table can be drawn again at its place."""
        return self._out.isatty() and not self.settings.structured and os.environ.get("TERM") != "dumb"

    @property
    def width(self) -> int | None:
        """Columns of the terminal, or None if stdout is not a terminal, whose lines are not wrapped."""
        return terminal_width(self._out)

    @property
    def height(self) -> int | None:
        """Lines of the terminal, or None if stdout is not a terminal."""
        return os.get_terminal_size(self._out.fileno()).lines if self._out.isatty() else None

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
            self._talk("message", text)

    def detail(self, text: str) -> None:
        """Print a message if --verbose is given."""
        if self.settings.verbose:
            self._talk("message", text)

    def warn(self, text: str) -> None:
        """Print a warning, also with --quiet."""
        self._talk("warning", text)

    def _talk(self, kind: str, text: str) -> None:
        self._redrawn = 0  # this line stays above the next redrawn text
        self._out.flush()  # where both go to one file, messages and results stay in their order
        line = visible_lines(text if kind == "message" else f"{kind}: {text}")
        shown = json_line({kind: text}) if self.settings.structured else self._fitted(line, self._err)
        print(shown, file=self._err, flush=True)

    @staticmethod
    def _fitted(text: str, stream: TextIO) -> str:
        return fitted_text(text, terminal_width(stream))

    def text(self, *lines: str) -> None:
        """Print lines of a result that is text, the long ones wrapped on a terminal."""
        print(self._fitted("\n".join(map(visible, lines)), self._out), file=self._out)

    def verbatim(self, text: str) -> None:
        """Print a result that is copied or read by programs, at once: a path, a shell command, a file.

        Only a terminal, which would obey them, gets its control characters as escape sequences.
        """
        print(visible_lines(text) if self._out.isatty() else text, file=self._out, flush=True)

    def now(self, *lines: str) -> None:
        """Print lines of a continuous result, flushed because a reader may follow it."""
        self.text(*lines)
        self._out.flush()

    def redraw(self, text: str, *, last: bool = False) -> None:
        """Print lines in place of the lines of the last call, each cut at the width of the terminal.

        As many lines as the terminal shows, because it does not move back to lines that have scrolled
        away; `last`: all lines, they are not drawn again.
        """
        width = terminal_columns()
        whole = visible_lines(text).split("\n")
        # the cursor is on the line below the last one
        lines = [line[:width] for line in (whole if last else clipped(whole, terminal_lines() - 1))]
        back = f"\x1b[{self._redrawn}F\x1b[J" if self._redrawn else ""
        self._redrawn = 0 if last else len(lines)
        print(back + "\n".join(lines), file=self._out, flush=True)

    def table(
        self,
        columns: Sequence[Column],
        rows: Sequence[Sequence[Cell]],
        title: str = "",
        *,
        empty: str = "nothing to list",
    ) -> None:
        """Print a result as a table; wide columns only with `-o wide`. Without rows the message `empty`."""
        if not rows:
            self.say(empty)
            return
        if self.settings.output != "wide" and any(column.wide for column in columns):
            kept = [place for place, column in enumerate(columns) if not column.wide]
            rows = [[row[place] for place in kept] for row in rows]
            columns = [columns[place] for place in kept]
        cells = [[show(cell) for cell in row] for row in rows]
        table = fitted_table(columns, cells, None if self.settings.output == "wide" else self.width)
        header = [f"\x1b[1m{line}\x1b[0m" for line in table.header] if self.fancy else table.header
        titled = [self._fitted(visible(title), self._out)] if title else []
        print("\n".join([*titled, *header, *table.rows]), file=self._out, flush=True)
        if table.hidden:
            self.say(f"-o wide also shows {', '.join(table.hidden)}")

    def document(self, value: msgspec.Struct) -> None:
        """Print the result for programs: the version of the schema, then the fields.

        As `jsonl` a result that begins with a list of objects is one line per item.
        """
        form: dict[str, Any] = json_form(value)
        rows = next(iter(form.values()), None)
        if self.settings.output == "jsonl" and isinstance(rows, list) and isinstance((rows or [{}])[0], dict):
            for row in rows:
                self._json_line(row)
        elif self.settings.output == "jsonl":
            self._json_line(form)
        else:
            self.exact({"schema_version": SCHEMA_VERSION, **form})

    def exact(self, value: Any) -> None:
        """Print a document with exactly these keys, as JSON or YAML."""
        if self.settings.output == "yaml":
            self._yaml(json_form(value))
            return
        data = msgspec.json.format(msgspec.json.encode(json_form(value)), indent=2)
        self.verbatim(json_escaped(data.decode()))

    def line(self, value: msgspec.Struct) -> None:
        """Print one item of a continuous result, flushed because a reader may follow it."""
        form: dict[str, Any] = json_form(value)
        if self.settings.output == "yaml":
            self._yaml({"schema_version": SCHEMA_VERSION, **form})
        else:
            self._json_line(form)

    def _json_line(self, form: dict[str, Any]) -> None:
        print(json_line(form), file=self._out, flush=True)

    def _yaml(self, form: Any) -> None:
        print(yaml_text(form), end="", file=self._out, flush=True)


def json_line(form: dict[str, Any]) -> str:
    """A document on one line."""
    return json_escaped(msgspec.json.encode({"schema_version": SCHEMA_VERSION, **form}).decode())


def yaml_text(form: Any) -> str:
    """One document of YAML: the data of its JSON, without raw control characters."""
    import yaml  # most commands print no YAML

    class Dumper(yaml.SafeDumper):
        """Writes texts with control characters between double quotes, where YAML has escape sequences."""

    def write_text(dumper: Dumper, text: str) -> yaml.ScalarNode:
        # a text of several lines, too: its block could hold the others raw
        style = '"' if HIDDEN.search(text) else None
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)

    Dumper.add_representer(str, write_text)
    plain = msgspec.json.decode(msgspec.json.encode(form))
    text: str = yaml.dump(plain, Dumper=Dumper, sort_keys=False, allow_unicode=True, explicit_start=True)
    return json_escaped(text)
