"""Values that an operator enters: JSON, a plain word, or the fields of a type as `name=value`."""

import json
import re
from typing import Any, Final

import msgspec

from swarmware.errors import InvalidInput, TypeMismatch
from swarmware.types.typed_value import field_value, value_of

_FIELD: Final = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)=(.*)\Z", re.DOTALL)


def entered(cls: type[msgspec.Struct], words: tuple[str, ...], path: str) -> msgspec.Struct:
    """The value of a type that the words mean; without a word all fields have their defaults.

    Raises: InvalidInput, TypeMismatch with the fields of the type.
    """
    found = [_FIELD.match(word) for word in words]
    single = cls.__struct_encode_fields__ == ("value",)
    if len(words) == 1 and single and (found[0] is None or found[0][1] != "value"):
        return value_of(cls, _plain_of(cls, "value", words[0], path), path)
    if words and all(found):
        plain: dict[str, Any] = {}
        for name, text in (match.groups() for match in found if match):
            _put(plain, name.split("."), _plain_of(cls, name, text, path), path)
        return value_of(cls, plain, path)
    if len(words) > 1:
        invalid = next(word for word, match in zip(words, found, strict=True) if not match)
        raise InvalidInput(f"{path}: value {invalid!r}; expected one value, or each word as field=value")
    return value_of(cls, json_or_text(words[0]) if words else {}, path)


def json_or_text(text: str) -> Any:
    """The plain value of a word: JSON, else the word itself.

    Raises: InvalidInput for JSON that is nested too deep.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise InvalidInput("value: nested too deep; expected JSON or a plain word") from None
    except ValueError:
        return text


def scalar_type(words: tuple[str, ...]) -> str:
    """Name of the common type of one plain word, or "" for a value with fields."""
    value = json_or_text(words[0]) if len(words) == 1 and not _FIELD.match(words[0]) else None
    return {bool: "Bool", int: "Int", float: "Float", str: "Text"}.get(type(value), "")


def _plain_of(cls: type[msgspec.Struct], name: str, text: str, path: str) -> Any:
    """Value of a field: parsed as JSON if that fits its type, else the word itself, as in `reason=5`."""
    value = json_or_text(text)
    kind = next((field.type for field in msgspec.structs.fields(cls) if field.encode_name == name), None)
    if kind is None or isinstance(value, str):
        return value
    try:
        field_value(kind, value, path)
    except TypeMismatch:
        try:
            return field_value(kind, text, path)
        except TypeMismatch:
            return value  # the error of the value as it was read is more precise
    return value


def _put(plain: dict[str, Any], names: list[str], value: Any, path: str) -> None:
    for name in names[:-1]:
        plain = plain.setdefault(name, {})
        if not isinstance(plain, dict):
            raise InvalidInput(
                f"{path}: field {name!r} is given as a whole and in parts; expected one of them"
            )
    if names[-1] in plain:
        raise InvalidInput(f"{path}: field {names[-1]!r} is given twice; expected once")
    plain[names[-1]] = value
