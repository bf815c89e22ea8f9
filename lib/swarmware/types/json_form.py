"""The JSON form of values: fields by name, 64-bit integers as text; and the JSON Schema of that form."""

import enum
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import msgspec

from swarmware.model.open_enum import OpenEnum

EXACT: Final = 1 << 53
"""Largest magnitude of an integer that every JSON reader keeps exactly (IEEE 754 double)."""

_IDENTITIES: Final = frozenset({"boot_id", "digest", "set_digest"})
_TEXT: Final = {"type": "string", "pattern": "^-?[0-9]+$", "description": "64-bit integer as text."}


def is_wide(name: str) -> bool:
    """Whether the integers of a field need 64 bits: nanoseconds and identities; they are always text."""
    return name.endswith("_ns") or is_identity(name)


def is_identity(name: str) -> bool:
    """Whether the integers of a field are identities: a rounded one is another one."""
    return name in _IDENTITIES


def json_form(value: Any, name: str = "") -> Any:
    """A value as plain data for JSON; `name` is the field that holds it.

    Integers of wide fields and those beyond 2^53 are text; bytes are their number.
    """
    return _named(value, name, _inexact)


def plottable_form(value: Any) -> Any:
    """As `json_form`, with all integers but identities as numbers: viewers plot no text."""
    return _named(value, "", lambda name, _: is_identity(name))


def plain(value: Any) -> Any:
    """A value as plain data with all integers as numbers: for databases, exports and calculation."""
    return _named(value, "", None)


def _inexact(name: str, number: int) -> bool:
    return is_wide(name) or abs(number) > EXACT


def _named(value: Any, name: str, is_text: Callable[[str, int], bool] | None) -> Any:
    if isinstance(value, msgspec.Struct):
        keys = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        return {key: _named(getattr(value, field), key, is_text) for key, field in keys}
    if isinstance(value, Mapping):
        return {str(key): _named(item, str(key), is_text) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_named(item, name, is_text) for item in value]
    if isinstance(value, bytes | bytearray | memoryview):
        return f"{len(value)} bytes"
    if isinstance(value, msgspec.msgpack.Ext):
        return f"{len(bytes(value.data))} bytes"
    if is_text is None or not isinstance(value, int) or isinstance(value, bool | enum.Enum):
        return value
    return str(value) if is_text(name, value) else value


class _Form(NamedTuple):
    is_text: Callable[[str], bool]
    """Whether the integers of a field are text."""
    packed: bool = False
    """As in MessagePack: a Struct that is encoded as an array is one, bytes are bytes."""


def json_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a type's JSON form; Structs are below `$defs`."""
    return _document(cls, _Form(is_wide))


def plottable_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema of a type's `plottable_form`; Structs are below `$defs`."""
    return _document(cls, _Form(is_identity))


def packed_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema of a type's MessagePack form; the items of an array have the fields' names as titles."""
    return _document(cls, _Form(lambda _: False, packed=True))


def _document(cls: Any, form: _Form) -> dict[str, Any]:
    defs: dict[str, Any] = {}
    found = _schema(msgspec.inspect.type_info(cls), "", defs, form)
    return {**found, "$defs": defs} if defs else found


def _schema(info: msgspec.inspect.Type, name: str, defs: dict[str, Any], form: _Form) -> dict[str, Any]:
    kinds = msgspec.inspect
    match info:
        case kinds.Metadata():
            return _schema(info.type, name, defs, form)
        case kinds.StructType():
            return _reference(info, defs, form)
        case kinds.UnionType():
            return {"anyOf": [_schema(one, name, defs, form) for one in info.types]}
        case kinds.NoneType():
            return {"type": "null"}
        case kinds.BoolType():
            return {"type": "boolean"}
        case kinds.IntType():
            return dict(_TEXT) if form.is_text(name) else {"type": "integer"}
        case kinds.FloatType():
            return {"type": "number" if form.packed else ["number", "null"]}  # in JSON NaN is null
        case kinds.BytesType() | kinds.ByteArrayType() | kinds.MemoryViewType() if form.packed:
            return {"description": "Bytes."}  # not a type of JSON
        case kinds.StrType() | kinds.BytesType() | kinds.ByteArrayType() | kinds.MemoryViewType():
            return {"type": "string"}
        case kinds.EnumType():
            values = [one.value for one in info.cls]
            is_open = issubclass(info.cls, OpenEnum)
            return {"type": "string", "examples": values} if is_open else {"enum": values}
        case kinds.LiteralType():
            return {"enum": list(info.values)}
        case kinds.DictType():
            return {"type": "object", "additionalProperties": _schema(info.value_type, "", defs, form)}
        case kinds.TupleType():
            items = [_schema(one, name, defs, form) for one in info.item_types]
            return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
        case kinds.ListType() | kinds.VarTupleType() | kinds.SetType() | kinds.FrozenSetType():
            return {"type": "array", "items": _schema(info.item_type, name, defs, form)}
        case _:
            return {}  # any value: that of a type of the user's own


def _reference(info: msgspec.inspect.StructType, defs: dict[str, Any], form: _Form) -> dict[str, Any]:
    name = info.cls.__name__
    if name not in defs:
        defs[name] = {}  # a type may hold itself
        description = (info.cls.__doc__ or "").strip().split("\n", 1)[0]
        fields = {
            field.encode_name: _schema(field.type, field.encode_name, defs, form) for field in info.fields
        }
        if form.packed and info.array_like:
            defs[name] = {
                "title": name,
                "description": description,
                "type": "array",
                "prefixItems": [{"title": key, **field} for key, field in fields.items()],
                "minItems": sum(field.required for field in info.fields),
            }
        else:
            required = [field.encode_name for field in info.fields if field.required or not form.packed]
            defs[name] = {
                "type": "object",
                "description": description,
                "required": required,
                "properties": fields,
            }
    return {"$ref": f"#/$defs/{name}"}
