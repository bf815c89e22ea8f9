"""Conversion of an operator's input to a value of a resource's type, with all checks."""

from typing import Any

import msgspec

from swarmware.errors import Denied, InvalidInput, NotFound
from swarmware.model.resource import Kind, Resource
from swarmware.types import registry
from swarmware.types.typed_value import check_limits, value_of

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

    Raises: TypeMismatch with the expected type, OutOfRange with the range.
    """
    value = value_of(cls or registry.find(resource.type), plain, path, resource.type)
    check_limits(resource, value, path)
    return value


def with_field(current: msgspec.Struct | None, fields: str, plain: Any, path: str) -> dict[str, Any]:
    """The fields of the present value with one of them replaced.

    Raises: NotFound if there is no value or no such field.
    """
    if current is None:
        raise NotFound(f"{path}: no value yet, so no field of it can be set; expected the whole value")
    names = current.__struct_encode_fields__
    if fields not in names:
        raise NotFound(f"{path}: no field {fields!r}; expected one of {', '.join(names)}")
    values = (getattr(current, field) for field in current.__struct_fields__)
    return dict(zip(names, values, strict=True)) | {fields: plain}


def unpacked(data: bytes, path: str) -> Any:
    """The plain data of a request.

    Raises: InvalidInput if it is not MessagePack.
    """
    try:
        return msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{path}: value is not MessagePack: {error}") from error
