"""The line of each key of a TOML text, which the parser of the standard library does not keep."""

import re
from collections.abc import Hashable
from typing import Final

KeyPath = tuple[Hashable, ...]
"""Keys, and indices of arrays, from the top of the document."""

_BLANK: Final = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*+")
_SPACE: Final = re.compile(r"[ \t]*+")
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
_STRING: Final = re.compile(
    r'"""(?:\\.|[^\\])*?"""(?:"{1,2})?|\'\'\'.*?\'\'\'(?:\'{1,2})?|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'',
    re.DOTALL,
)
_SCALAR: Final = re.compile(r"[^,\]}#\r\n]+")
_ESCAPE: Final = re.compile(r"\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|(.))", re.DOTALL)
_CONTROL: Final = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r"}


def toml_lines(text: str) -> dict[KeyPath, int]:
    """The line, from 1, of each key, table and item of a text that `tomllib` accepts.

    An invalid text gives the lines of the part that was understood.
    """
    reader = _Reader(text)
    reader.document()
    return reader.lines


def line_of(lines: dict[KeyPath, int], path: KeyPath) -> int:
    """The line of the value at this path, else of the nearest table around it, or 0 if no line is known."""
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path, 0)


def key_text(path: KeyPath) -> str:
    """A path as a document has it: `roles[2].params."a b"`."""
    out = ""
    for part in path:
        if isinstance(part, int):
            out += f"[{part}]"
            continue
        word = str(part)
        out += ("." if out else "") + (word if _BARE.fullmatch(word) else f'"{word}"')
    return out


class _Reader:
    """One pass over the text; each method starts at a token and returns after it."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._source = text
        self._at = 0
        self._counted_to = 0
        self._line = 1
        self._tables: dict[KeyPath, int] = {}
        """Number of the tables in each array of tables."""

    def document(self) -> None:
        table: KeyPath = ()
        while self._skip(_BLANK):
            before = self._at
            if self._next("[["):
                table = self._header("]]", array=True)
            elif self._next("["):
                table = self._header("]", array=False)
            else:
                self._pair(table)
            if self._at == before:
                return  # invalid

    def _skip(self, blank: re.Pattern[str]) -> bool:
        found = blank.match(self._source, self._at)
        self._at = found.end() if found else self._at
        return self._at < len(self._source)

    def _next(self, token: str) -> bool:
        if self._source.startswith(token, self._at):
            self._at += len(token)
            return True
        return False

    def _mark(self, path: KeyPath, at: int) -> None:
        self._line += self._source.count("\n", self._counted_to, at)
        self._counted_to = at
        self.lines.setdefault(path, self._line)

    def _header(self, end: str, *, array: bool) -> KeyPath:
        at = self._at
        parts = self._key()
        path: KeyPath = ()
        for number, part in enumerate(parts, 1):
            path = (*path, part)
            self._mark(path, at)
            if array and number == len(parts):
                self._tables[path] = self._tables.get(path, 0) + 1
            if path in self._tables:
                path = (*path, self._tables[path] - 1)
                self._mark(path, at)
        self._skip(_SPACE)
        self._next(end)
        return path

    def _key(self) -> list[str]:
        parts: list[str] = []
        while self._skip(_SPACE):
            if found := _STRING.match(self._source, self._at):
                parts.append(_content(found[0]))
            elif found := _BARE.match(self._source, self._at):
                parts.append(found[0])
            else:
                break
            self._at = found.end()
            self._skip(_SPACE)
            if not self._next("."):
                break
        return parts

    def _pair(self, table: KeyPath) -> None:
        at = self._at
        path = table
        for part in self._key():
            path = (*path, part)
            self._mark(path, at)
        if path == table:
            return
        self._skip(_SPACE)
        if self._next("="):
            self._skip(_SPACE)
            self._value(path)

    def _value(self, path: KeyPath) -> None:
        if self._next("["):
            self._array(path)
        elif self._next("{"):
            self._inline_table(path)
        else:
            found = _STRING.match(self._source, self._at) or _SCALAR.match(self._source, self._at)
            self._at = found.end() if found else self._at

    def _array(self, path: KeyPath) -> None:
        index = 0
        while self._skip(_BLANK) and not self._next("]"):
            before = self._at
            self._mark((*path, index), before)
            self._value((*path, index))
            self._skip(_BLANK)
            self._next(",")
            if self._at == before:
                return  # invalid
            index += 1

    def _inline_table(self, path: KeyPath) -> None:
        while self._skip(_BLANK) and not self._next("}"):
            before = self._at
            self._pair(path)
            self._skip(_BLANK)
            self._next(",")
            if self._at == before:
                return  # invalid


def _content(quoted: str) -> str:
    """The text of a quoted key."""
    if quoted.startswith("'"):
        return quoted[1:-1]
    return _ESCAPE.sub(_unescaped, quoted[1:-1])


def _unescaped(found: re.Match[str]) -> str:
    code = found[1] or found[2]
    if code:
        number = int(code, 16)
        return chr(number) if number <= 0x10FFFF else ""
    return _CONTROL.get(found[3], found[3])
