"""Paths of fields inside a value: `sensors["sensor/gnss"]`, `drivers[0].state`."""

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import msgspec

Scalar = bool | float | str
"""Type of the values that a condition compares."""

STEPS_PATTERN: Final = r"(?:\.[A-Za-z0-9_]+|\[\s*(?:\d{1,9}|'[^']*'|\"[^\"]*\")\s*\])*"
"""Regular expression of a field path after the path of its resource; it may be empty."""

_STEP: Final = re.compile(
    r"(?:^|\.)(?P<name>[A-Za-z0-9_]+)|\[\s*(?:(?P<index>\d+)|'(?P<text>[^']*)'|\"(?P<quoted>[^\"]*)\")\s*\]"
)


class FieldStep(msgspec.Struct, frozen=True):
    """One step of a field path."""

    key: str | int
    """Name of a field, key of a map, or index of a list."""
    quoted: bool = False
    """Whether the step is a text in brackets: a key of a map, or an item that a list may contain."""

    def __str__(self) -> str:
        if self.quoted:
            return f"['{self.key}']" if '"' in str(self.key) else f'["{self.key}"]'
        return f"[{self.key}]" if isinstance(self.key, int) else f".{self.key}"


@lru_cache(maxsize=1024)
def steps(path: str) -> tuple[FieldStep, ...]:
    """The steps of a field path."""
    found: list[FieldStep] = []
    for step in _STEP.finditer(path):
        if (name := step["name"] or step["index"]) is not None:
            found.append(FieldStep(int(name) if name.isdecimal() else name))
        else:
            found.append(FieldStep(step["text"] if step["quoted"] is None else step["quoted"], quoted=True))
    return tuple(found)


def scalar_of(value: msgspec.Struct | None, path: str) -> Scalar | None:
    """The number, text or truth value at a field path, or None if the value has none there.

    An empty path means the only field of the value.
    """
    found: Any = value
    fields: tuple[str, ...] = getattr(value, "__struct_fields__", ())
    if len(fields) == 1 and (not path or path.startswith("[")):
        found = getattr(value, fields[0])
    for step in steps(path):
        found = _after(found, step)
    return found if isinstance(found, bool | int | float | str) else None


def _after(value: Any, step: FieldStep) -> Any:
    if isinstance(value, Mapping):
        return _of_map(value, step)
    if isinstance(value, list | tuple):
        if step.quoted:
            return step.key in value
        return value[step.key] if isinstance(step.key, int) and step.key < len(value) else None
    return getattr(value, step.key, None) if isinstance(step.key, str) and not step.quoted else None


def _of_map(value: Mapping[Any, Any], step: FieldStep) -> Any:
    """The element with this key; a name after a dot also means the only path that ends with it (`.gnss`)."""
    for key in (step.key, str(step.key)):
        if key in value:
            return value[key]
    if step.quoted or isinstance(step.key, int):
        return None
    paths = [key for key in value if str(key).endswith(f"/{step.key}")]
    return value[paths[0]] if len(paths) == 1 else None
