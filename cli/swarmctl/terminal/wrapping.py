"""Texts within the width of a terminal, without breaking a word."""

import re
from typing import Final, TextIO

from swarmctl.terminal.size import terminal_columns
from swarmware.types.units import UNITS

_LABEL: Final = re.compile(r"\s*\S.*?\s{2,}(?=\S)")
"""Begin of a line up to its first column: a label and at least two blanks."""
_BREAK: Final = re.compile(r"(?<=[/,=])(?![/,:=])|(?<=:)(?<!\d:)(?![/,:=])|(?<=:)(?![/,:=\d])")
_INDENT: Final = "  "
_UNITS: Final = frozenset(
    {unit for _, unit in UNITS} | {"%", "B", "kB", "MB", "MiB", "GiB", "B/s", "kB/s", "min", "h", "d"}
)
"""Texts that stay behind their number."""
_NUMBER: Final = re.compile(r"[(+-]*\d[\d.,e+-]*")


def terminal_width(stream: TextIO) -> int | None:
    """Columns of the terminal behind a stream, or None without one, so that lines are not wrapped."""
    return terminal_columns() if stream.isatty() else None


def clipped(lines: list[str], height: int) -> list[str]:
    """At most `height` lines; the last one states how many are hidden."""
    if len(lines) <= height:
        return lines
    kept = max(height - 1, 0)
    return [*lines[:kept], f"… and {len(lines) - kept} more lines"]


def fitted_text(text: str, width: int | None) -> str:
    """The text with its long lines wrapped, or unchanged if `width` is None.

    A line continues below its first column, or indented by two blanks.
    """
    if width is None or all(len(line) <= width for line in text.splitlines()):
        return text
    lines: list[str] = []
    for line in text.splitlines():
        if len(line) <= width:
            lines.append(line)
            continue
        label = _LABEL.match(line)
        # a wider label would leave too little room for the text beside it
        head = label[0] if label and len(label[0]) <= width // 3 else ""
        blanks = line[: len(line) - len(line.lstrip())]
        indent = " " * len(head) if head else blanks + _INDENT
        lines += wrapped(line[len(head) :].strip(), width, head or blanks, indent)
    return "\n".join(lines)


def wrapped(text: str, width: int | None, head: str = "", indent: str = "") -> list[str]:
    """Lines of at most `width` characters, the first behind `head`, the others behind `indent`.

    A line ends between two words, else after the punctuation of a path or a list; a part that is longer
    than a line stays whole. None: one line.
    """
    if width is None or len(head) + len(text) <= width:
        return [(head + text).rstrip()]
    lines, empty = [head], True
    for word in words(text):
        gap = "" if empty else " "
        if len(lines[-1]) + len(gap) + len(word) <= width:
            lines[-1] += gap + word
        elif len(indent) + len(word) <= width:
            lines = [*lines, indent + word] if lines[-1].strip() else [indent + word]
        else:
            for part in atoms(word):
                if lines[-1].strip() and len(lines[-1]) + len(gap) + len(part) > width:
                    lines.append(indent)
                    gap = ""
                lines[-1] += gap + part
                gap = ""
        empty = False
    return [line.rstrip() for line in lines]


def words(text: str) -> list[str]:
    """Parts of a text between blanks; a number and its unit are one part."""
    found: list[str] = []
    for word in text.split():
        if found and word.rstrip(",.;:)") in _UNITS and _NUMBER.fullmatch(found[-1]):
            found[-1] += f" {word}"
        else:
            found.append(word)
    # never empty, as a cell without text still takes a line
    return found or [""]


def atoms(text: str) -> list[str]:
    """Parts between which a path or a list may be broken: after `/`, `,`, `=` and `:`, but not in a time."""
    return [part for part in _BREAK.split(text) if part] or [""]
