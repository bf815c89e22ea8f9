"""Conversion of values between wire format and text."""

import re
from typing import Any

import msgspec

from swarmware.errors import InvalidInput, SwarmError
from swarmware.model.frame import Codec
from swarmware.model.visible import visible
from swarmware.recorder.entry import list_or_none
from swarmware.types import registry
from swarmware.types.json_form import plain


def decoded(cls: type[msgspec.Struct] | None, data: bytes | memoryview, codec: Codec = Codec.NONE) -> Any:
    """A payload as plain data with field names, or the bare value of a Struct with a single field.

    `cls`: None for a type without a description, whose payload stays a list or map as on the wire.
    """
    if cls is not None:
        try:
            return single(registry.decode(cls, data, codec))
        except SwarmError:
            pass  # its owner has another version of the type: shown as on the wire
    return plain(list_or_none(bytes(data)))


def single(value: msgspec.Struct) -> Any:
    """A value as plain data, or the bare value of a Struct with a single field."""
    found = plain(value)
    # the scalar types (Float, Text …) are Structs with the one field `value`
    return found["value"] if isinstance(found, dict) and found.keys() == {"value"} else found


def field(value: Any, path: str, fields: str) -> Any:
    """One field of a value, by its dotted name, or as in conditions.

    `ranges_m.0` and `ranges_m[0]` are the first of a list, `sensors["sensor/gnss"]` is an element of a map.
    Raises: InvalidInput naming the existing fields.
    """
    for name in _names(fields):
        if isinstance(value, dict) and name in value:
            value = value[name]
        elif isinstance(value, list) and name.isdigit() and int(name) < len(value):
            value = value[int(name)]
        else:
            raise InvalidInput(f"{path}: no field {name!r}; expected {_fields(value)}")
    return value


def _names(fields: str) -> list[str]:
    if "[" not in fields:
        return [name for name in fields.split(".") if name]
    from swarmware.mission.field_path import STEPS_PATTERN, steps  # not for plain names

    if not re.fullmatch(rf"[A-Za-z0-9_]*{STEPS_PATTERN}", fields):
        raise InvalidInput(f'field {fields!r}: expected indices such as [0], or keys such as ["sensor/gnss"]')
    return [str(step.key) for step in steps(fields)]


def select(value: Any, path: str, fields: str, names: tuple[str, ...] = ()) -> Any:
    """The field with the dotted name `fields`, reduced to its fields `names`: one bare, several by name.

    Raises: InvalidInput naming the existing fields.
    """
    value = field(value, path, fields)
    if len(names) == 1:
        return field(value, path, names[0])
    return {name: field(value, path, name) for name in names} if names else value


def _fields(value: Any) -> str:
    if isinstance(value, dict):
        return f"one of {', '.join(value)}"
    if isinstance(value, list):
        return f"0 to {len(value) - 1}" if value else "none, the list is empty"
    return f"none, it is the value {brief(value)}"


def brief(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, float):
        return f"{value:.9g}"
    return msgspec.json.encode(rounded(value)).decode()


def rounded(value: Any) -> Any:
    """The value with numbers rounded for display."""
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return value
