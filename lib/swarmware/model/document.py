"""Reads TOML and JSON files with limits; each error is a ConfigError that names file and line."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from swarmware.errors import ConfigError

T = TypeVar("T")

SIZE_LIMIT: Final = 4 << 20
"""Maximum bytes of one file; the largest shipped one has 20 kB."""
DEPTH_LIMIT: Final = 32
"""Maximum nesting of a file; the deepest known one has 6."""
_INTEGER_MIN: Final = -(1 << 63)
_GREATEST_INTEGER: Final = (1 << 64) - 1

_BYTE = re.compile(r"\(byte (\d+)\)")
_DIGITS = re.compile(r"\d[\d_]{1000,}")
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
    """Decode the bytes of a file.

    Raises: ConfigError when they are too many or not UTF-8.
    """
    if len(data) > SIZE_LIMIT:
        raise ConfigError(f"{source}: more than {SIZE_LIMIT} bytes; expected a smaller file")
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
        raise ConfigError(f"{source}: line {line}: a key of more than {DEPTH_LIMIT} parts")
    try:
        raw = tomllib.loads(content)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source}: invalid TOML: {error}") from error
    except RecursionError as error:
        raise ConfigError(_too_deep(content, source)) from error
    except ValueError as error:  # a number of thousands of digits
        found = _DIGITS.search(content)
        where = f"{source}: line {_line(content, found.start())}" if found else source
        raise ConfigError(f"{where}: invalid TOML: a number of more than 64 bits") from error
    _check(raw, content, source, finite=finite)
    return raw


def json(content: str, cls: type[T], source: str) -> T:
    """Parse JSON as a typed value.

    Raises: ConfigError naming source, line or key, and what was expected.
    """
    data = content.encode()
    try:
        return msgspec.json.decode(data, type=cls)
    except msgspec.DecodeError as error:
        found = _BYTE.search(str(error))
        line = data.count(b"\n", 0, int(found[1])) + 1 if found else 0
        where = f"{source}: line {line}" if line else source
        raise ConfigError(f"{where}: {error}") from error
    except RecursionError as error:
        raise ConfigError(_too_deep(content, source)) from error
    except ValueError as error:
        raise ConfigError(f"{source}: invalid JSON: {error}") from error


def _check(raw: dict[str, Any], content: str, source: str, *, finite: bool) -> None:
    """Refuses valid TOML that exceeds the limits; level by level, because the depth is not bounded yet."""
    level: list[tuple[str, Any]] = list(raw.items())
    for _ in range(DEPTH_LIMIT):
        below: list[tuple[str, Any]] = []
        for key, value in level:
            if isinstance(value, dict):
                below += ((f"{key}.{name}", item) for name, item in value.items())
            elif isinstance(value, list):
                below += ((f"{key}[{index}]", item) for index, item in enumerate(value))
            elif isinstance(value, float) and finite and not math.isfinite(value):
                raise ConfigError(f"{source}: key {key}: {value}; expected a finite number")
            elif isinstance(value, int) and not _INTEGER_MIN <= value <= _GREATEST_INTEGER:
                raise ConfigError(f"{source}: key {key}: a number of more than 64 bits")
        if not below:
            return
        level = below
    raise ConfigError(_too_deep(content, source))


def _too_deep(content: str, source: str) -> str:
    depth = 0
    for found in re.finditer(r"[\[{\]}]", content):
        depth += 1 if found[0] in "[{" else -1
        if depth > DEPTH_LIMIT:
            source = f"{source}: line {_line(content, found.start())}"
            break
    return f"{source}: nested more than {DEPTH_LIMIT} deep"


def _line(content: str, at: int) -> int:
    return content.count("\n", 0, at) + 1
