"""Reads TOML and JSON files with limits; each error is a ConfigError that names file and line."""

from __future__ import annotations

import codecs
import math
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import msgspec

from swarmware.errors import ConfigError
from swarmware.model.foreign_format import foreign_format

if TYPE_CHECKING:
    from swarmware.model.toml_lines import KeyPath

T = TypeVar("T")

SIZE_LIMIT: Final = 4 << 20
"""Maximum bytes of one file; the largest shipped one has 20 kB."""
DEPTH_LIMIT: Final = 32
"""Maximum nesting of a file; the deepest known one has 6."""
LINES_LIMIT: Final = 1 << 18
"""Maximum characters of a text in which the line of an error is searched."""
_WIDE_MARKS: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF32_BE)
"""Byte order marks of other encodings; the mark of UTF-32 LE begins with the one of UTF-16 LE."""
_INTEGER_MIN: Final = -(1 << 63)
_GREATEST_INTEGER: Final = (1 << 64) - 1

# needed for errors only, so compiled when an error occurs
_BYTE: Final = r"\(byte (\d+)\)"
_TOML_PLACE: Final = r"\(at line (\d+), column \d+\)"
_DIGITS: Final = r"\d[\d_]{1000,}"
_LONG_KEY = re.compile(
    r"""(?m)(?:^|[\[{,])[ \t]*+(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    f"{{{DEPTH_LIMIT}}}"
)
"""A dotted key deeper than that: the parser's time grows with the square of its length."""


def read(path: Path) -> str:
    """Read the text of a file.

    Raises: FileNotFoundError; ConfigError when it cannot be read, is too large or not UTF-8.
    """
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_LIMIT + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    return text(data, str(path))


def text(data: bytes, source: str) -> str:
    """Decode the bytes of a file; a byte order mark before UTF-8 is skipped.

    Raises: ConfigError when they are too many, not UTF-8, or a file of another tool.
    """
    data = data.removeprefix(codecs.BOM_UTF8)
    if what := foreign_format(data):
        message = f"{what}: not readable here; expected a file of Swarmware, TOML or JSON"
        raise ConfigError(message, source=source)
    if len(data) > SIZE_LIMIT:
        raise ConfigError(f"{source}: more than {SIZE_LIMIT} bytes; expected a smaller file")
    if data.startswith(_WIDE_MARKS) or b"\0" in data[:2]:
        raise ConfigError(f"{source}: cannot be read: UTF-16 or UTF-32; save as UTF-8")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{source}: line {line}: cannot be read: not UTF-8: {error.reason}") from error


def toml(content: str, source: str, *, finite: bool = True) -> dict[str, Any]:
    """Parse a TOML text; `finite`: refuse nan and inf.

    Raises: ConfigError naming source, and line or key.
    """
    if len(content) > SIZE_LIMIT:
        raise ConfigError(f"{source}: more than {SIZE_LIMIT} characters; expected a smaller file")
    if long_key := _LONG_KEY.search(content):
        line = _line(content, long_key.end())
        raise ConfigError(f"a key of more than {DEPTH_LIMIT} parts", source=source, line=line)
    try:
        raw = tomllib.loads(content)
    except tomllib.TOMLDecodeError as error:
        found = re.search(_TOML_PLACE, str(error))
        line = int(found[1]) if found else content.count("\n") + 1
        raise ConfigError(f"invalid TOML: {error}", source=source, line=line) from error
    except RecursionError as error:
        raise _too_deep(content, source) from error
    except ValueError as error:  # a number of thousands of digits
        found = re.search(_DIGITS, content)
        line = _line(content, found.start()) if found else 0
        message = "invalid TOML: a number of more than 64 bits"
        raise ConfigError(message, source=source, line=line) from error
    _check(raw, content, source, finite=finite)
    return raw


def json(content: str, cls: type[T], source: str) -> T:
    """Parse JSON as a typed value.

    Raises: ConfigError naming source, line or key, and the expected value.
    """
    data = content.encode()
    try:
        return msgspec.json.decode(data, type=cls)
    except msgspec.DecodeError as error:
        found = re.search(_BYTE, str(error))
        line = data.count(b"\n", 0, int(found[1])) + 1 if found else 0
        raise ConfigError(str(error), source=source, line=line) from error
    except RecursionError as error:
        raise _too_deep(content, source) from error
    except ValueError as error:
        raise ConfigError(f"{source}: invalid JSON: {error}") from error


def refusal(source: str, content: str, path: KeyPath, message: str) -> ConfigError:
    """The error about the value at this path of a TOML text."""
    from swarmware.model.toml_lines import line_of, toml_lines  # a valid document needs no lines

    lines = toml_lines(content) if len(content) <= LINES_LIMIT else {}
    return ConfigError(message, source=source, line=line_of(lines, path))


def _check(raw: dict[str, Any], content: str, source: str, *, finite: bool) -> None:
    """Refuses valid TOML that exceeds the limits; level by level, because the depth is not bounded yet."""
    level: list[tuple[KeyPath, Any]] = [((key,), value) for key, value in raw.items()]
    for _ in range(DEPTH_LIMIT):
        below: list[tuple[KeyPath, Any]] = []
        for path, value in level:
            if isinstance(value, dict):
                below += (((*path, name), item) for name, item in value.items())
            elif isinstance(value, list):
                below += (((*path, index), item) for index, item in enumerate(value))
            elif isinstance(value, float) and finite and not math.isfinite(value):
                raise _key_refusal(source, content, path, f"{value}; expected a finite number")
            elif isinstance(value, int) and not _INTEGER_MIN <= value <= _GREATEST_INTEGER:
                raise _key_refusal(source, content, path, "a number of more than 64 bits")
        if not below:
            return
        level = below
    raise _too_deep(content, source)


def _key_refusal(source: str, content: str, path: KeyPath, message: str) -> ConfigError:
    from swarmware.model.toml_lines import key_text

    return refusal(source, content, path, f"key {key_text(path)}: {message}")


def _too_deep(content: str, source: str) -> ConfigError:
    depth = line = 0
    for found in re.finditer(r"[\[{\]}]", content):
        depth += 1 if found[0] in "[{" else -1
        if depth > DEPTH_LIMIT:
            line = _line(content, found.start())
            break
    return ConfigError(f"nested more than {DEPTH_LIMIT} deep", source=source, line=line)


def _line(content: str, at: int) -> int:
    return content.count("\n", 0, at) + 1
