"""Conversion of values between wire format and text."""

import json
from typing import Any

import msgspec

from swarmware.errors import InvalidInput, SwarmError
from swarmware.recorder.entry import list_or_none, plain
from swarmware.types import registry
from swarmware.types.tree import TreeValue


def decoded(value: TreeValue) -> Any:
    """The value as plain data with field names."""
    return decoded_payload(value.type, value.data)


def decoded_payload(type_name: str, data: bytes) -> Any:
    """MessagePack of a type as plain data with field names; a single value without its Struct."""
    try:
        value = registry.decode(registry.find(type_name), data)
    except SwarmError:
        return list_or_none(data)  # a type that is not installed here
    return single(value)


def single(value: msgspec.Struct) -> Any:
    """A value as plain data; a single value without its Struct."""
    found = plain(value)
    return found["value"] if isinstance(found, dict) and found.keys() == {"value"} else found


def field(value: Any, path: str, fields: str) -> Any:
    """One field of a value, by its dotted name; `ranges_m.0` is the first of a list.

    Raises: InvalidInput naming the existing fields.
    """
    for name in filter(None, fields.split(".")):
        if isinstance(value, dict) and name in value:
            value = value[name]
        elif isinstance(value, list) and name.isdigit() and int(name) < len(value):
            value = value[int(name)]
        else:
            raise InvalidInput(f"{path}: no field {name!r}; expected {_fields(value)}")
    return value


def _fields(value: Any) -> str:
    if isinstance(value, dict):
        return f"one of {', '.join(value)}"
    if isinstance(value, list):
        return f"0 to {len(value) - 1}" if value else "none, the list is empty"
    return f"none, it is the value {brief(value)}"


def typed(text: str) -> bytes:
    """Encode a value of an operator, JSON or a plain word, as MessagePack."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise InvalidInput("value: nested too deep; expected JSON or a plain word") from None
    except ValueError:
        value = text
    return msgspec.msgpack.encode(value)


def brief(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, str):
        return value
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
