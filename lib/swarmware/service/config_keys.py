"""The keys of a configuration class: type, unit, default, permitted values and meaning."""

from collections.abc import Iterator
from functools import cache
from typing import Any, Final

import msgspec

from swarmware.types.description import field_docs
from swarmware.types.units import unit_of

_TOML: Final = {
    msgspec.inspect.NoneType: "none",
    msgspec.inspect.BoolType: "boolean",
    msgspec.inspect.IntType: "integer",
    msgspec.inspect.FloatType: "float",
    msgspec.inspect.StrType: "string",
    msgspec.inspect.EnumType: "string",
    msgspec.inspect.LiteralType: "string",
    msgspec.inspect.DictType: "tables",
    msgspec.inspect.AnyType: "any",
    msgspec.inspect.StructType: "table",
}


StructClass = type[msgspec.Struct]


class KeyDescription(msgspec.Struct, frozen=True):
    """One key of a configuration file."""

    name: str
    """Dotted: `altitude.kp_1_s`."""
    type: str
    unit: str
    limits: str
    """Permitted values, or "" if the type is the only limit."""
    default: Any
    """Plain default, or None if TOML omits it."""
    required: bool
    cls: StructClass
    """The class that has the field."""
    field: str
    item: StructClass | None = None
    """Class of the tables of an array of tables."""

    @property
    def meaning(self) -> str:
        """The docstring below the field, or "" without the source text."""
        return _docs(self.cls).get(self.field, "")


@cache
def _docs(cls: type[msgspec.Struct]) -> dict[str, str]:
    return field_docs(cls)


@cache
def described_keys(cls: type[msgspec.Struct]) -> tuple[KeyDescription, ...]:
    """Every key of a file, including keys of its tables; an array of tables is one key."""
    return tuple(_described(cls, ""))


def _described(cls: type[msgspec.Struct], prefix: str) -> Iterator[KeyDescription]:
    info = msgspec.inspect.type_info(cls)
    assert isinstance(info, msgspec.inspect.StructType)
    for field in info.fields:
        kind, name = without_none(field.type), f"{prefix}{field.encode_name}"
        if isinstance(kind, msgspec.inspect.StructType):
            yield from _described(kind.cls, f"{name}.")
            continue
        inside = _item(kind)
        item = inside.cls if isinstance(inside, msgspec.inspect.StructType) else None
        number = inside if inside is not None else kind
        yield KeyDescription(
            name,
            "array of tables" if item else toml_type(kind),
            "" if item else unit_of(field.name, whole=isinstance(number, msgspec.inspect.IntType)),
            permitted(kind),
            None if field.required else msgspec.to_builtins(_default(field)),
            field.required,
            cls,
            field.name,
            item,
        )


def _default(field: msgspec.inspect.Field) -> Any:
    if msgspec.NODEFAULT is field.default is field.default_factory:
        return None  # UNSET
    return field.default_factory() if field.default is msgspec.NODEFAULT else field.default


def without_none(kind: msgspec.inspect.Type) -> msgspec.inspect.Type:
    """The type of a key that may be left out."""
    while isinstance(kind, msgspec.inspect.Metadata):
        kind = kind.type
    if isinstance(kind, msgspec.inspect.UnionType):
        rest = [one for one in kind.types if not isinstance(one, msgspec.inspect.NoneType)]
        return rest[0] if len(rest) == 1 else kind
    return kind


def _item(kind: msgspec.inspect.Type) -> msgspec.inspect.Type | None:
    return (
        kind.item_type if isinstance(kind, msgspec.inspect.VarTupleType | msgspec.inspect.ListType) else None
    )


def toml_type(kind: msgspec.inspect.Type) -> str:
    """Name of a type in a TOML file."""
    match kind:
        case msgspec.inspect.Metadata(type=inner):
            return toml_type(inner)
        case msgspec.inspect.VarTupleType(item_type=item) | msgspec.inspect.ListType(item_type=item):
            return f"array of {_plural(toml_type(item))}"
        case msgspec.inspect.TupleType(item_types=items):
            return f"array of {len(items)} {_plural(toml_type(items[0]))}"
        case msgspec.inspect.DictType(value_type=msgspec.inspect.UnionType() as value):
            return f"table; each value {toml_type(value)}"
        case msgspec.inspect.UnionType(types=types):
            return " or ".join(sorted({toml_type(one) for one in types} - {"none"}))
    return _TOML.get(type(kind), "any")


def _plural(word: str) -> str:
    return word.replace("array", "arrays", 1) if word.startswith("array") else f"{word}s"


def permitted(kind: msgspec.inspect.Type) -> str:
    """The permitted values of a key: an interval, a pattern, or the values themselves."""
    match kind:
        case msgspec.inspect.Metadata(type=inner):
            return permitted(inner)
        case msgspec.inspect.IntType() | msgspec.inspect.FloatType():
            return _interval(kind)
        case msgspec.inspect.StrType(pattern=str(pattern)):
            return f"`{pattern}`"
        case msgspec.inspect.StrType(min_length=int(low), max_length=int(high)):
            return f"{low} to {high} characters"
        case msgspec.inspect.UnionType(types=types):
            rest = (one for one in types if not isinstance(one, msgspec.inspect.BoolType))
            return " or ".join(filter(None, map(permitted, rest)))
        case msgspec.inspect.LiteralType(values=values):
            return ", ".join(f"`{value}`" if value else "empty" for value in values)
        case msgspec.inspect.EnumType(cls=cls):
            return ", ".join(f"`{one.value}`" for one in cls)
        case msgspec.inspect.BoolType():
            return "`true`, `false`"
        case msgspec.inspect.VarTupleType(item_type=item) | msgspec.inspect.TupleType(item_types=(item, *_)):
            found = permitted(item)
            smallest = getattr(kind, "min_length", None)
            exact = smallest and smallest == getattr(kind, "max_length", None)
            count = f"{'' if exact else 'at least '}{smallest}" if smallest else ""
            return ", ".join(filter(None, (count, f"each {found}" if found else "")))
    return ""


def _interval(kind: msgspec.inspect.IntType | msgspec.inspect.FloatType) -> str:
    low = f"[{_number(kind.ge)}" if kind.ge is not None else f"({_number(kind.gt)}"
    high = f"{_number(kind.le)}]" if kind.le is not None else f"{_number(kind.lt)})"
    if (low, high) == ("(", ")"):
        return ""
    return f"{'(−∞' if low == '(' else low}, {'∞)' if high == ')' else high}"


def _number(bound: float | None) -> str:
    if bound is None:
        return ""
    exact = int(bound) if bound == int(bound) else bound
    return str(exact).replace("-", "−")
