"""Types of the fields that a field path leads to, and refusals of paths that lead nowhere."""

from functools import cache
from typing import Any, Final, get_type_hints

import msgspec
import msgspec.inspect

from swarmware.mission.field_path import FieldStep
from swarmware.model.names import similar

NUMBER: Final = "a number"
TRUTH: Final = "true or false"
TEXT: Final = "a text"


class FieldType(msgspec.Struct, frozen=True):
    """Type and permitted values of an operand."""

    name: str
    sort: str = ""
    """Number, truth value or string, or "" if the type is not installed."""
    choices: tuple[str, ...] = ()
    """Permitted strings, or () if any string is permitted."""
    span: tuple[float, float] | None = None
    """Minimum and maximum of the number."""


def element(found: Any, step: FieldStep, name: str) -> tuple[Any, str]:
    """Type of what a step leads to from a type, and the refusal of a step that leads nowhere.

    `name`: of the value of that type, for the refusal.
    """
    match found:
        case msgspec.inspect.StructType() if not step.quoted:
            inner = fields_of(found.cls)
            if step.key in inner:
                return inner[str(step.key)], ""
            near = [field for field in inner if field.startswith(f"{step.key}_")]  # its unit was left out
            near += similar(str(step.key), inner, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else "expected one of these"
            return None, f"{found.cls.__name__} has no field {step.key!r}; {hint} ({', '.join(inner)})"
        case msgspec.inspect.DictType():
            keys = () if (key := plain_type(name, present(found.key_type))) is None else key.choices
            if keys and str(step.key) not in keys:
                return None, f"{name} has no key {str(step.key)!r}: expected one of {', '.join(keys)}"
            return found.value_type, ""
        case _ if (items := _items(found)) is not None:
            if isinstance(step.key, int):
                if not isinstance(found, msgspec.inspect.TupleType):
                    return items[0], ""
                if step.key >= len(items):
                    return None, f"{name} has {len(items)} items: expected an index below that, from 0"
                return items[step.key], ""
            sample = plain_type(name, present(items[0]))
            if not step.quoted or sample is None or sample.sort not in {TEXT, ""}:
                return None, f"{name} is a list: expected an index, such as {name}[0], not {str(step)!r}"
            if sample.choices and step.key not in sample.choices:
                return None, f"{name} never has {step.key!r}: expected one of {', '.join(sample.choices)}"
            return msgspec.inspect.BoolType(), ""
        case msgspec.inspect.AnyType() | msgspec.inspect.UnionType():
            return msgspec.inspect.AnyType(), ""
    return None, f"{name} is {_described(found)}: expected nothing after it, not {str(step)!r}"


def _items(found: Any) -> tuple[Any, ...] | None:
    """Types of the items of a list, one for all if they are alike, or None for any other type."""
    match found:
        case msgspec.inspect.TupleType():
            return tuple(found.item_types) or (msgspec.inspect.AnyType(),)
        case msgspec.inspect.ListType() | msgspec.inspect.VarTupleType():
            return (found.item_type,)
    return None


def _described(found: Any) -> str:
    if isinstance(found, msgspec.inspect.StructType):
        return f"a {found.cls.__name__}"
    value = plain_type("", found)
    return value.sort if value is not None and value.sort else "a single value"


def parts_of(found: Any) -> str:
    """Description of a value that has parts, and what names one of them."""
    match found:
        case msgspec.inspect.StructType():
            names = ", ".join(fields_of(found.cls))
            return f"a {found.cls.__name__}: expected one of its fields ({names})"
        case msgspec.inspect.DictType():
            return 'a map: expected one of its keys in brackets, such as ["sensor/gnss"]'
        case _ if _items(found) is not None:
            return "a list: expected the index of an item in brackets, such as [0]"
    return "no number, text or truth value: expected a field that is one"


@cache
def fields_of(cls: type[msgspec.Struct]) -> dict[str, Any]:
    """Types of its fields and properties, by name."""
    info: Any = msgspec.inspect.type_info(cls)
    found = {field.name: field.type for field in info.fields}
    for name in dir(cls):
        attribute = getattr(cls, name, None)
        # properties count as fields: conditions may use derived values
        if isinstance(attribute, property) and not name.startswith("_") and attribute.fget is not None:
            returns = get_type_hints(attribute.fget).get("return")
            if returns in {bool, int, float, str}:
                found[name] = msgspec.inspect.type_info(returns)
    return found


def present(found: Any) -> Any:
    """The type of a value that is present, without None."""
    if isinstance(found, msgspec.inspect.UnionType):
        types = [kind for kind in found.types if not isinstance(kind, msgspec.inspect.NoneType)]
        return types[0] if len(types) == 1 else found
    return found


def plain_type(name: str, found: Any) -> FieldType | None:
    """The type of a number, text or truth value, or None for a value that has parts."""
    match found:
        case msgspec.inspect.BoolType():
            return FieldType(name, TRUTH)
        case msgspec.inspect.IntType() | msgspec.inspect.FloatType():
            return FieldType(name, NUMBER)
        case msgspec.inspect.StrType():
            return FieldType(name, TEXT)
        case msgspec.inspect.EnumType():
            values = tuple(member.value for member in found.cls)
        case msgspec.inspect.LiteralType():
            values = tuple(found.values)
        case msgspec.inspect.UnionType() | msgspec.inspect.AnyType():
            return FieldType(name)
        case _:
            return None
    if all(isinstance(value, str) for value in values):
        return FieldType(name, TEXT, values)
    return FieldType(name, NUMBER)
