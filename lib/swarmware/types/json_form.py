"""The JSON form of values: fields by name, 64-bit integers as text; and the JSON Schema of that form."""

import binascii
import enum
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec

from swarmware.model.open_enum import OpenEnum

Buffer: TypeAlias = bytes | bytearray | memoryview
"""Types of bytes."""
EXACT: Final = 1 << 53
"""Largest magnitude of an integer that every JSON reader keeps exactly (IEEE 754 double)."""

_IDENTITIES: Final = frozenset({"boot_id", "digest", "set_digest"})
_TEXT: Final = {"type": "string", "pattern": "^-?[0-9]+$", "description": "64-bit integer as text."}


def is_wide(name: str) -> bool:
    """Whether the integers of a field need 64 bits: nanoseconds and identities; they are always text."""
    return name.endswith("_ns") or is_identity(name)


def is_identity(name: str) -> bool:
    """Whether the integers of a field are identities, which rounding would change."""
    return name in _IDENTITIES


def json_form(value: Any, name: str = "") -> Any:
    """A value as plain data for JSON; `name` is the field that holds it.

    Integers of wide fields and those beyond 2^53 are text; bytes are their number.
    """
    return _named(value, name, _JSON)


def exported_form(value: Any) -> Any:
    """A value as by `json_form`, but with bytes as base64: for files, which keep everything."""
    return _named(value, "", _EXPORTED)


def plottable_form(value: Any) -> Any:
    """A value as by `exported_form`, but with all integers except identities as numbers, which viewers can
    plot."""
    return _named(value, "", _PLOTTABLE)


def plain(value: Any) -> Any:
    """A value as plain data with all integers as numbers, bytes as their number: for output and databases."""
    return _named(value, "", _PLAIN)


def text_form(value: Any) -> Any:
    """A value as by `plain`, but with bytes as base64: for tables and calculation."""
    return _named(value, "", _TEXT_FORM)


def _inexact(name: str, number: int) -> bool:
    return is_wide(name) or abs(number) > EXACT


def _size(data: Buffer) -> str:
    return f"{len(memoryview(data).cast('B'))} bytes"


def _base64(data: Buffer) -> str:
    return binascii.b2a_base64(data, newline=False).decode()


class _Style(NamedTuple):
    """Form of values as plain data."""

    is_text: Callable[[str, int], bool] | None
    """Function that decides whether an integer of a field is text, or None if no integer is."""
    data: Callable[[Buffer], str]
    """Text of bytes."""


_JSON: Final = _Style(_inexact, _size)
_EXPORTED: Final = _Style(_inexact, _base64)
_PLOTTABLE: Final = _Style(lambda name, _: is_identity(name), _base64)
_PLAIN: Final = _Style(None, _size)
_TEXT_FORM: Final = _Style(None, _base64)


def _named(value: Any, name: str, style: _Style) -> Any:
    if isinstance(value, msgspec.Struct):
        fields = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        return {key: _named(getattr(value, field), key, style) for key, field in fields}
    if isinstance(value, Mapping):
        keys = _keys(value)
        return {key: _named(item, key, style) for key, item in zip(keys, value.values(), strict=True)}
    if isinstance(value, list | tuple | set | frozenset):
        return [_named(item, name, style) for item in value]
    if isinstance(value, bytes | bytearray | memoryview):
        return style.data(value)
    if isinstance(value, msgspec.msgpack.Ext):
        return style.data(bytes(value.data))
    if style.is_text is None or not isinstance(value, int) or isinstance(value, bool | enum.Enum):
        return value
    return str(value) if style.is_text(name, value) else value


def _keys(value: Mapping[Any, Any]) -> list[str]:
    """Keys of a map as different texts: 1 and "1" are two keys in MessagePack."""
    keys = [str(key) for key in value]
    if len(set(keys)) == len(keys):
        return keys
    taken = {key for key in value if isinstance(key, str)}
    for place, key in enumerate(value):
        number = 1
        while not isinstance(key, str) and keys[place] in taken:
            number += 1
            keys[place] = f"{key}_{number}"
        taken.add(keys[place])
    return keys


class _Form(NamedTuple):
    is_text: Callable[[str], bool]
    """Whether the integers of a field are text."""
    packed: bool = False
    """True for the form of MessagePack: a Struct that is encoded as an array stays an array, and bytes
    bytes."""
    encoded: bool = False
    """Whether bytes are base64."""


def json_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a type's JSON form; Structs are below `$defs`."""
    return _document(cls, _Form(is_wide))


def plottable_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema of a type's `plottable_form`; Structs are below `$defs`."""
    return _document(cls, _Form(is_identity, encoded=True))


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
        case kinds.BytesType() | kinds.ByteArrayType() | kinds.MemoryViewType() if form.encoded:
            return {"type": "string", "contentEncoding": "base64"}
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
            return {}  # a type of the user's own has no schema: any value is valid


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
