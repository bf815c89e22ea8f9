"""Values of a type from plain data: numbers, texts, lists and maps, as an operator enters them."""

from typing import Any, Protocol

import msgspec

from swarmware.errors import OutOfRange, TypeMismatch
from swarmware.types.units import unit_suffix


class Limits(Protocol):
    """Limits of the plain value of a resource, in its descriptor."""

    @property
    def unit(self) -> str:
        """Unit of the resource, for the error."""
        ...

    @property
    def range(self) -> tuple[float, float] | None:
        """Minimum and maximum permitted number, both included."""
        ...

    @property
    def choices(self) -> tuple[str, ...]:
        """The permitted texts, or () if any text is permitted."""
        ...


def value_of(cls: type[msgspec.Struct], plain: Any, path: str, name: str = "") -> msgspec.Struct:
    """A value of a type, from a map or list of its fields, or from the plain value of its only field `value`.

    Types inside it are given in the same way. `path`: place for the error. `name`: of the type, if its class
    has another one.
    Raises: TypeMismatch with the place and the expected value.
    """
    name = name or cls.__name__
    fields = list(cls.__struct_encode_fields__)
    if fields == ["value"] and not isinstance(plain, dict | list):
        plain = {"value": plain}
    if isinstance(plain, list | tuple):
        if len(plain) > len(fields):
            raise TypeMismatch(f"{path}: {len(plain)} items; {name} has the fields {', '.join(fields)}")
        plain = dict(zip(fields, plain, strict=False))
    if not isinstance(plain, dict):
        raise TypeMismatch(f"{path}: {plain!r} is not a {name}; expected its fields {', '.join(fields)}")
    strange = [field for field in plain if field not in fields]
    if strange:
        raise TypeMismatch(f"{path}: no field {strange[0]!r} in {name}; expected some of {', '.join(fields)}")
    given: dict[str, Any] = {}
    for field in msgspec.structs.fields(cls):
        if field.encode_name in plain:
            where = path if field.encode_name == "value" else f"{path}.{field.encode_name}"
            given[field.name] = field_value(field.type, plain[field.encode_name], where)
        elif field.required:
            raise TypeMismatch(f"{path}: field {field.encode_name!r} of {name} is missing")
    try:
        return cls(**given)
    except ValueError as error:  # a type that checks its fields together
        raise TypeMismatch(f"{path}: {error}") from error


def field_value(kind: Any, plain: Any, where: str) -> Any:
    """The value of one field from plain data.

    Raises: TypeMismatch with the place and the expected value.
    """
    try:
        made = _inside(msgspec.inspect.type_info(kind), plain, where)
        return msgspec.convert(made, kind, strict=True)
    except RecursionError:
        raise TypeMismatch(f"{where}: nested too deep") from None
    except msgspec.ValidationError as error:
        text = str(error)
        raise TypeMismatch(f"{where}: {text[:1].lower()}{text[1:]} (it is {plain!r})") from error


def check_limits(limits: Limits, value: msgspec.Struct, path: str) -> None:
    """Check a plain value against the range and the choices of its resource.

    Raises: OutOfRange with the expected range or choices.
    """
    number = getattr(value, "value", None)
    if limits.range is not None and isinstance(number, int | float):
        low, high = limits.range
        if not low <= number <= high:
            unit = unit_suffix(limits.unit)
            raise OutOfRange(f"{path}: {number:g}{unit}; expected {low:g} to {high:g}{unit}")
    if limits.choices and number not in limits.choices:
        raise OutOfRange(f"{path}: {number!r}; expected one of {', '.join(limits.choices)}")


def _inside(info: Any, plain: Any, where: str) -> Any:
    """The plain data with values instead of maps where a type is meant: on the wire it may be an array."""
    kinds = msgspec.inspect
    match info:
        case kinds.Metadata():
            return _inside(info.type, plain, where)
        case kinds.StructType() if isinstance(plain, dict | list) and info.tag is None:
            return value_of(info.cls, plain, where)
        case kinds.UnionType():
            structs = [one for one in info.types if isinstance(one, kinds.StructType)]
            holders = [one for one in info.types if isinstance(one, _HOLDERS)]
            if isinstance(plain, dict) and len(structs) == 1:
                return _inside(structs[0], plain, where)
            return _inside(holders[0], plain, where) if len(holders) == 1 else plain
        case kinds.ListType() | kinds.VarTupleType() if isinstance(plain, list | tuple):
            return [_inside(info.item_type, one, f"{where}.{n}") for n, one in enumerate(plain)]
        case kinds.TupleType() if isinstance(plain, list | tuple) and len(plain) == len(info.item_types):
            parts = zip(info.item_types, plain, strict=True)
            return [_inside(kind, one, f"{where}.{n}") for n, (kind, one) in enumerate(parts)]
        case kinds.DictType() if isinstance(plain, dict):
            return {key: _inside(info.value_type, one, f"{where}.{key}") for key, one in plain.items()}
    return plain


_HOLDERS = (
    msgspec.inspect.ListType,
    msgspec.inspect.VarTupleType,
    msgspec.inspect.TupleType,
    msgspec.inspect.DictType,
)
"""Types that hold others."""
