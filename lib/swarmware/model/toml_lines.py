"""The lines of a TOML text on which keys have their values."""

import tomllib
from typing import Any, Final

STATEMENT_LIMIT: Final = 500
"""Lines of one statement, an array for example; the line of what follows a longer one is not found."""


def key_lines(text: str) -> dict[str, int]:
    """Line of each dotted key, from 1; an array of tables has the line of its first table.

    The text is valid TOML: a statement ends at the first line at which it is valid alone.
    """
    found: dict[str, int] = {}
    table = ""
    statement, first = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        first = first or number
        statement += f"{line}\n"
        try:
            raw = tomllib.loads(statement)
        except tomllib.TOMLDecodeError:
            if number - first >= STATEMENT_LIMIT:
                break
            continue
        if statement.lstrip().startswith("["):
            table = _header(raw)
            if statement.lstrip().startswith("[["):
                found.setdefault(table, first)
        else:
            for key in _keys(raw, table):
                found.setdefault(key, first)
        statement, first = "", 0
    return found


def _header(raw: dict[str, Any]) -> str:
    """The dotted name of a table's header."""
    parts = []
    level: Any = raw
    while isinstance(level, dict) and level:
        ((name, level),) = level.items()
        parts.append(name)
    return ".".join(parts)


def _keys(raw: dict[str, Any], prefix: str) -> list[str]:
    """Dotted keys with a value; those of an inline table too."""
    found = []
    for name, value in raw.items():
        key = f"{prefix}.{name}" if prefix else name
        found.append(key)
        if isinstance(value, dict):
            found += _keys(value, key)
    return found
