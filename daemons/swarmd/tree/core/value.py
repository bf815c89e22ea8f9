"""Conversion of an operator's input to a value of a resource's type, with all checks."""

from typing import Any

import msgspec

from swarmware.errors import Denied, InvalidInput, NotFound, OutOfRange, TypeMismatch
from swarmware.model.resource import Kind, Resource
from swarmware.types import registry

_SETTABLE = frozenset({Kind.SETTING, Kind.COMMAND, Kind.BOARD})


def check_settable(resource: Resource, path: str) -> None:
    """Raises: Denied if only the owner may set it, InvalidInput if it has no value."""
    if resource.kind not in _SETTABLE:
        raise InvalidInput(f"{path}: a {resource.kind} cannot be set; expected a setting, command or board")
    if not resource.writable and resource.kind is not Kind.COMMAND:
        owner = resource.owner or "its owner"
        raise Denied(f"{path}: access {resource.access}; only {owner} sets it")


def typed(
    resource: Resource, plain: Any, path: str, cls: type[msgspec.Struct] | None = None
) -> msgspec.Struct:
    """The value of the resource's type; `cls`: its class, if it is not a common one.

    Raises: TypeMismatch with what was expected, OutOfRange with the range.
    """
    cls = cls or registry.find(resource.type)
    fields = [field.name for field in msgspec.structs.fields(cls)]
    if fields == ["value"] and not isinstance(plain, dict | list):
        plain = {"value": plain}
    if isinstance(plain, list | tuple):
        if len(plain) > len(fields):
            raise TypeMismatch(
                f"{path}: {len(plain)} items; {resource.type} has the fields {', '.join(fields)}"
            )
        plain = dict(zip(fields, plain, strict=False))
    if not isinstance(plain, dict):
        raise TypeMismatch(
            f"{path}: {plain!r} is not a {resource.type}; expected its fields {', '.join(fields)}"
        )
    strange = [name for name in plain if name not in fields]
    if strange:
        raise TypeMismatch(
            f"{path}: no field {strange[0]!r} in {resource.type}; expected some of {', '.join(fields)}"
        )
    value = _made(cls, plain, path)
    _check_range(resource, value, path)
    return value


def _made(cls: type[msgspec.Struct], plain: dict[str, Any], path: str) -> msgspec.Struct:
    given: dict[str, Any] = {}
    for field in msgspec.structs.fields(cls):
        if field.name not in plain:
            if field.required:
                raise TypeMismatch(f"{path}: field {field.name!r} of {cls.__name__} is missing")
            continue
        try:
            given[field.name] = msgspec.convert(plain[field.name], field.type, strict=True)
        except msgspec.ValidationError as error:
            where = path if field.name == "value" else f"{path}.{field.name}"
            text = str(error)
            raise TypeMismatch(
                f"{where}: {text[:1].lower()}{text[1:]} (it is {plain[field.name]!r})"
            ) from error
    return cls(**given)


def _check_range(resource: Resource, value: msgspec.Struct, path: str) -> None:
    number = getattr(value, "value", None)
    if resource.range is not None and isinstance(number, int | float) and not resource.in_range(number):
        low, high = resource.range
        unit = f" {resource.unit}" if resource.unit else ""
        raise OutOfRange(f"{path}: {number:g}{unit}; expected {low:g} to {high:g}{unit}")
    if resource.choices and number not in resource.choices:
        raise OutOfRange(f"{path}: {number!r}; expected one of {', '.join(resource.choices)}")


def with_field(current: msgspec.Struct | None, fields: str, plain: Any, path: str) -> dict[str, Any]:
    """The fields of the present value with one of them replaced.

    Raises: NotFound if there is no value or no such field.
    """
    if current is None:
        raise NotFound(f"{path}: no value yet, so no field of it can be set; expected the whole value")
    names = list(current.__struct_fields__)
    if fields not in names:
        raise NotFound(f"{path}: no field {fields!r}; expected one of {', '.join(names)}")
    return {name: getattr(current, name) for name in names} | {fields: plain}


def unpacked(data: bytes, path: str) -> Any:
    """The plain data of a request.

    Raises: InvalidInput if it is not MessagePack.
    """
    try:
        return msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{path}: value is not MessagePack: {error}") from error
