"""Descriptions of payload types: fields, types and meaning, for who does not have the class."""

import ast
import inspect
import textwrap
from itertools import pairwise
from typing import Annotated, Any, Final

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register

FIELDS_LIMIT: Final = 500
STRUCTS_LIMIT: Final = 100
NAME_LIMIT: Final = 200
EXPRESSION_LIMIT: Final = 1000
TEXT_LIMIT: Final = 1000

_WHOLE: Final = frozenset({"int", "int | None"})

_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=NAME_LIMIT)]
_Text = Annotated[str, msgspec.Meta(max_length=TEXT_LIMIT)]


@register
class FieldDescription(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One field of a described type."""

    name: _Name
    """Name in maps; of an array the place counts."""
    type: Annotated[str, msgspec.Meta(min_length=1, max_length=EXPRESSION_LIMIT)]
    """`float`, `list[Point]`, `tuple[float, ...]`, `dict[str, int]`, `'auto' | 'manual'`, `float | None`;
    an open vocabulary is `str | 'auto' | 'manual'`, and `Any` is everything else."""
    required: bool = True
    default: bytes = b""
    """MessagePack of the default of a field that is not required."""
    low: int | float | None = None
    high: int | float | None = None
    """Smallest and largest permitted number, each None without such a limit."""
    meaning: _Text = ""

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers only."""
        return self.type in _WHOLE


@register
class StructDescription(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The fields of one described type, in their order."""

    name: _Name
    fields: Annotated[tuple[FieldDescription, ...], msgspec.Meta(max_length=FIELDS_LIMIT)] = ()
    meaning: _Text = ""
    array: bool = False
    """MessagePack: the array of the fields; else a map by their names."""


@register
class TypeDescription(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A payload type and the types of its fields; answer of `sys/tree/type`."""

    structs: Annotated[tuple[StructDescription, ...], msgspec.Meta(min_length=1, max_length=STRUCTS_LIMIT)]
    """The type itself, then those that its fields name."""

    @property
    def top(self) -> StructDescription:
        """The described type itself, without the others."""
        return self.structs[0]


def describe(cls: type[msgspec.Struct]) -> TypeDescription:
    """Description of a type; the meaning of its fields is read from the source, if there is one."""
    return _Describer(cls).result()


class _Describer:
    """Follows the fields of a type to the types that they name."""

    def __init__(self, cls: type[msgspec.Struct]) -> None:
        self._top = cls
        self._names: dict[Any, str] = {}
        self._found: dict[str, StructDescription] = {}

    def result(self) -> TypeDescription:
        self._name_of(msgspec.inspect.type_info(self._top))
        top = self._names[self._top]
        return TypeDescription((self._found.pop(top), *self._found.values()))

    def _name_of(self, info: Any) -> str:
        """Name of a type with fields; described when it is met first."""
        cls = info.cls
        if cls not in self._names:
            name = cls.__name__
            number = 1
            while name in self._names.values():
                number += 1
                name = f"{cls.__name__}_{number}"
            self._names[cls] = name
            if len(self._names) > STRUCTS_LIMIT:
                return "Any"
            docs = field_docs(cls)
            array = isinstance(info, msgspec.inspect.NamedTupleType) or getattr(info, "array_like", False)
            fields = [self._field(field, docs) for field in info.fields[:FIELDS_LIMIT]]
            if (tag := getattr(info, "tag", None)) is not None:
                field_name = info.tag_field or "type"
                fields.insert(0, FieldDescription(field_name, repr(tag), meaning="Tag of the type."))
            meaning = _line(inspect.cleandoc(cls.__doc__ or ""))
            self._found[name] = StructDescription(name, tuple(fields), meaning, array)
        return self._names[cls]

    def _field(self, field: msgspec.inspect.Field, docs: dict[str, str]) -> FieldDescription:
        low, high = _limits(field.type)
        expression = self.expression(field.type)
        if len(expression) > EXPRESSION_LIMIT:
            expression = "Any"
        default = b""
        if not field.required:
            made = field.default_factory() if field.default is msgspec.NODEFAULT else field.default
            default = _packed(made)
        return FieldDescription(
            field.encode_name,
            expression,
            field.required,
            default,
            low,
            high,
            docs.get(field.name, "")[:TEXT_LIMIT],
        )

    def expression(self, info: Any) -> str:
        """A type as text."""
        kinds = msgspec.inspect
        match info:
            case kinds.Metadata():
                return self.expression(info.type)
            case kinds.StructType() | kinds.DataclassType() | kinds.TypedDictType() | kinds.NamedTupleType():
                return self._name_of(info)
            case kinds.UnionType():
                return " | ".join(dict.fromkeys(map(self.expression, info.types)))
            case kinds.LiteralType():
                return " | ".join(map(repr, info.values))
            case kinds.EnumType():
                values = [one.value for one in info.cls]
                if not all(isinstance(value, str | int) for value in values):
                    return "Any"
                known = " | ".join(repr(value) for value in values) or "Any"
                return f"str | {known}" if issubclass(info.cls, OpenEnum) else known
            case kinds.TupleType(item_types=items):
                return f"tuple[{', '.join(map(self.expression, items))}]" if items else "Any"
            case kinds.VarTupleType():
                return f"tuple[{self.expression(info.item_type)}, ...]"
            case kinds.ListType() | kinds.SetType() | kinds.FrozenSetType():
                return f"list[{self.expression(info.item_type)}]"
            case kinds.DictType():
                return f"dict[{self.expression(info.key_type)}, {self.expression(info.value_type)}]"
            case _:
                return _SIMPLE.get(type(info), "Any")


_SIMPLE: Final[dict[type, str]] = {
    msgspec.inspect.NoneType: "None",
    msgspec.inspect.BoolType: "bool",
    msgspec.inspect.IntType: "int",
    msgspec.inspect.FloatType: "float",
    msgspec.inspect.StrType: "str",
    msgspec.inspect.BytesType: "bytes",
    msgspec.inspect.ByteArrayType: "bytes",
    msgspec.inspect.MemoryViewType: "bytes",
}


def _limits(info: Any) -> tuple[int | float | None, int | float | None]:
    if not isinstance(info, msgspec.inspect.IntType | msgspec.inspect.FloatType):
        return None, None
    low, high = info.ge, info.le
    return None if low == -(1 << 63) else low, None if high == (1 << 63) - 1 else high


def _packed(value: Any) -> bytes:
    """A default as MessagePack, or b"" if there is no default or no MessagePack for it."""
    try:
        return msgspec.msgpack.encode(value)
    except (TypeError, OverflowError, ValueError):
        return b""


def _line(text: str) -> str:
    """The first paragraph on one line."""
    return " ".join(text.partition("\n\n")[0].split())[:TEXT_LIMIT]


def field_docs(cls: type) -> dict[str, str]:
    """The docstrings below the fields of a class and of those that it inherits from."""
    found: dict[str, str] = {}
    for one in reversed(cls.__mro__[:-1]):
        if one.__module__ == "msgspec":
            continue
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(one)))
        except (OSError, TypeError, SyntaxError, ValueError):
            continue  # typed at a prompt, or shipped without its source
        if tree.body and isinstance(tree.body[0], ast.ClassDef):
            body = tree.body[0].body
            for field, below in pairwise(body):
                match field, below:
                    case (
                        ast.AnnAssign(target=ast.Name(id=name)),
                        ast.Expr(value=ast.Constant(value=str(text))),
                    ):
                        found[name] = _line(inspect.cleandoc(text))
    return found
