"""Names and possible values of the fields of a type, for completion."""

from typing import Any, Final

import msgspec

DEPTH: Final = 3
"""Depth of nested types that are followed; a recursive type ends there."""


def field_values(cls: type[msgspec.Struct]) -> dict[str, list[str]]:
    """Dotted names of the fields, each with its permitted values, or [] if any value is permitted."""
    found: dict[str, list[str]] = {}
    _add(found, msgspec.inspect.type_info(cls), "", DEPTH)
    return found


def _add(found: dict[str, list[str]], info: Any, before: str, depth: int) -> None:
    for field in info.fields:
        kind = _present(field.type)
        name = f"{before}{field.encode_name}"
        if isinstance(kind, msgspec.inspect.StructType) and depth:
            _add(found, kind, f"{name}.", depth - 1)
        else:
            found[name] = _values(kind)


def _present(kind: Any) -> Any:
    """A type without limits and without None."""
    if isinstance(kind, msgspec.inspect.Metadata):
        return _present(kind.type)
    if isinstance(kind, msgspec.inspect.UnionType):
        types = [one for one in kind.types if not isinstance(one, msgspec.inspect.NoneType)]
        return _present(types[0]) if len(types) == 1 else kind
    return kind


def _values(kind: Any) -> list[str]:
    match kind:
        case msgspec.inspect.BoolType():
            return ["true", "false"]
        case msgspec.inspect.EnumType():
            return [str(one.value) for one in kind.cls]
        case msgspec.inspect.LiteralType():
            return [str(value) for value in kind.values]
    return []
