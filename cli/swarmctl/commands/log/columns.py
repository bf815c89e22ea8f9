"""Columns of the table of a type: by its fields, so that they are the same in every export."""

import base64
import enum
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any, Final

import msgspec

from swarmware.types.json_form import is_identity, text_form

HEAD: Final = ("utc", "utc_ns", "stamp_ns", "path", "sender")
"""Names of the columns of every table."""
VALUE: Final = "value"
"""Column of a value without fields; prefix of a field with the name of a column of every table."""


class ColumnKind(enum.Enum):
    """Contents of a column."""

    BOOL = enum.auto()
    INT = enum.auto()
    """64 bits with sign."""
    UINT = enum.auto()
    """64 bits without sign."""
    FLOAT = enum.auto()
    TEXT = enum.auto()
    BYTES = enum.auto()
    JSON = enum.auto()
    """Any value, as JSON."""
    LIST = enum.auto()
    RECORD = enum.auto()
    """Several named values, in a list: elsewhere each is a column."""


class Content(msgspec.Struct, frozen=True):
    """ColumnKind of a column, and of its parts."""

    kind: ColumnKind
    raw: bool = False
    """Whether decoded values have the type of the column, so that `exact` has nothing to convert."""
    item: "Content | None" = None
    """Of the items of a list."""
    fields: "tuple[tuple[str, str, Content], ...]" = ()
    """Of a record: names in the table, attributes, contents."""


class TableColumn(msgspec.Struct, frozen=True):
    """A column with the values of one field, which may be inside others."""

    name: str
    path: tuple[str, ...]
    """Attributes of Structs, or keys of maps, from the value to the field."""
    content: Content


_JSON: Final = Content(ColumnKind.JSON)


def columns_of(cls: type[msgspec.Struct]) -> list[TableColumn]:
    """Columns of a type: one for each field; the fields of a nested type are named with a dot."""
    found = list(_flat(msgspec.inspect.type_info(cls), (), (), (), ""))
    return named((".".join(names), path, content) for names, path, content in found)


def named(columns: Iterable[tuple[str, tuple[str, ...], Content]]) -> list[TableColumn]:
    """Columns with a name each: a name that another one has gets a number."""
    taken = set(HEAD)
    out: list[TableColumn] = []
    for text, path, content in columns:
        # a field must not take the name of a column that every table has
        wanted = f"{VALUE}.{text}" if text in HEAD else text or VALUE
        name, number = wanted, 1
        while name in taken:
            number += 1
            name = f"{wanted}_{number}"
        taken.add(name)
        out.append(TableColumn(name, path, content))
    return out


_Found = tuple[tuple[str, ...], tuple[str, ...], Content]


def _flat(
    info: Any, names: tuple[str, ...], path: tuple[str, ...], above: tuple[Any, ...], name: str
) -> Iterable[_Found]:
    """Columns of a field: one, or one for each field of a nested type."""
    info = _required(info)
    # a type that contains itself would give columns without an end, so its inner values are one cell
    if isinstance(info, msgspec.inspect.StructType) and info.cls not in above and info.fields:
        for field in info.fields:
            inner = (*names, field.encode_name), (*path, field.name)
            yield from _flat(field.type, *inner, (*above, info.cls), field.encode_name)
    else:
        yield names, path, _content(info, above, name)


def _required(info: Any) -> Any:
    """The type of a field without its limits, and without null."""
    kinds = msgspec.inspect
    while isinstance(info, kinds.Metadata):
        info = info.type
    if isinstance(info, kinds.UnionType):
        types = [one for one in info.types if not isinstance(one, kinds.NoneType)]
        if len(types) == 1:
            return _required(types[0])
    return info


def _content(info: Any, above: tuple[Any, ...], name: str) -> Content:
    kinds = msgspec.inspect
    info = _required(info)
    match info:
        case kinds.BoolType():
            return Content(ColumnKind.BOOL, raw=True)
        case kinds.IntType():
            # identities are 64-bit hashes, half of which exceed a signed integer
            unsigned = is_identity(name) or (info.le or 0) >= 1 << 63
            return Content(ColumnKind.UINT if unsigned else ColumnKind.INT, raw=True)
        case kinds.FloatType():
            return Content(ColumnKind.FLOAT, raw=True)
        case kinds.StrType():
            return Content(ColumnKind.TEXT, raw=True)
        case kinds.BytesType():
            return Content(ColumnKind.BYTES, raw=True)
        case kinds.ByteArrayType() | kinds.MemoryViewType():
            return Content(ColumnKind.BYTES)
        case kinds.EnumType():
            return _of_values([one.value for one in info.cls])
        case kinds.LiteralType():
            return _of_values(info.values)
        case kinds.UnionType() if {type(one) for one in info.types} <= {
            kinds.IntType,
            kinds.FloatType,
            kinds.NoneType,
        }:
            return Content(ColumnKind.FLOAT)
        case kinds.UnionType():
            contents = {_content(one, above, name) for one in info.types if not _is_null(one)}
            if {one.kind for one in contents} == {ColumnKind.TEXT}:
                return Content(ColumnKind.TEXT)
            return contents.pop() if len(contents) == 1 else _JSON
        case kinds.ListType() | kinds.VarTupleType() | kinds.SetType() | kinds.FrozenSetType():
            return _list_of([_content(info.item_type, above, name)])
        case kinds.TupleType():
            return _list_of([_content(one, above, name) for one in info.item_types])
        case kinds.StructType() if info.cls not in above and info.fields:
            inside = (*above, info.cls)
            fields = tuple(
                (field.encode_name, field.name, _content(field.type, inside, field.encode_name))
                for field in info.fields
            )
            return Content(ColumnKind.RECORD, fields=fields)
    return _JSON


def _is_null(info: Any) -> bool:
    return isinstance(info, msgspec.inspect.NoneType)


def _of_values(values: Iterable[Any]) -> Content:
    """Content of an enumeration."""
    kinds = {type(value) for value in values}
    if kinds <= {str}:
        return Content(ColumnKind.TEXT)
    return Content(ColumnKind.INT) if kinds == {int} else _JSON


def _list_of(items: list[Content]) -> Content:
    """Content of a list: items of several kinds are JSON."""
    if not items or any(one != items[0] for one in items):
        return _JSON
    return Content(ColumnKind.LIST, item=items[0])


def cells_of(columns: Sequence[TableColumn]) -> Callable[[Any], Sequence[Any]]:
    """Function that returns the columns of a decoded Struct, each None if a part of its path is None."""
    paths = [column.path for column in columns]
    if len(paths) > 1 and all(len(path) == 1 for path in paths):
        # several names in one call of C, for types without nested fields; a single name would give no tuple
        return attrgetter(*(path[0] for path in paths))
    return lambda value: [_part(value, path) for path in paths]


def _part(value: Any, path: tuple[str, ...]) -> Any:
    for name in path:
        if value is None:
            return None
        value = getattr(value, name)
    return value


def exact(value: Any, content: Content) -> Any:
    """A value as plain data for a typed column."""
    if value is None:
        return None
    match content.kind:
        case ColumnKind.JSON:
            return json_text(value)
        case ColumnKind.TEXT:
            return value.value if isinstance(value, enum.Enum) else value
        case ColumnKind.INT | ColumnKind.UINT:
            return int(value)
        case ColumnKind.FLOAT:
            return float(value)
        case ColumnKind.BYTES:
            return bytes(value)
        case ColumnKind.LIST if content.item is not None:
            return [exact(item, content.item) for item in value]
        case ColumnKind.RECORD:
            return {name: exact(getattr(value, field), one) for name, field, one in content.fields}
    return value


def text(value: Any) -> Any:
    """A value as a cell of a text table: base64 for bytes, JSON for several values, empty for none."""
    if value is None:
        return ""
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, bytes | bytearray | memoryview):
        return base64.b64encode(value).decode()
    return value if isinstance(value, bool | int | float | str) else json_text(value)


def json_text(value: Any) -> str:
    """A value as JSON, with its bytes as base64; the text itself of a value whose JSON is a string."""
    form = text_form(value)
    if isinstance(form, str):
        return str(form)
    return msgspec.json.encode(form).decode()
