"""Payload types of recorded values: of the library by name, of modules by the description in the log."""

from functools import lru_cache
from typing import Final

import msgspec

from swarmware.errors import NotFound, WireError
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.description import TypeDescription, describe
from swarmware.types.json_form import packed_schema

DESCRIPTION_LIMIT: Final = 48_000
"""Bytes of a description in a log: it is in the record of each channel, which has at most 65536."""


@lru_cache(maxsize=256)
def logged_description(text: str) -> str:
    """The description of a type as a log has it, without the meaning of the fields.

    Empty if it is invalid or too long, and the values are recorded without it.
    """
    try:
        found = _without_meaning(_decoded(text))
        class_of(found)
    except WireError:
        return ""
    logged = msgspec.json.encode(found)
    return logged.decode() if len(logged) <= DESCRIPTION_LIMIT else ""


def payload_class(name: str, description: str) -> type[msgspec.Struct]:
    """The class of a recorded type. `description`: of a type of a module, else empty.

    Raises: NotFound, WireError.
    """
    return _described_class(name, description) if description else registry.find(name)


@lru_cache(maxsize=256)
def _described_class(name: str, description: str) -> type[msgspec.Struct]:
    found = _decoded(description)
    try:
        registered = registry.find(name)
        if _without_meaning(describe(registered)) == found:
            return registered
    except (NotFound, NameError, TypeError, ValueError):
        pass  # not installed here, or in another version
    return class_of(found)


@lru_cache(maxsize=256)
def schema(name: str, description: str = "") -> bytes:
    """JSON Schema of a type's MessagePack form, for other readers, or "" if the type is unknown."""
    try:
        return msgspec.json.encode(packed_schema(payload_class(name, description)))
    except (NotFound, WireError, TypeError):
        return b""


def _decoded(text: str) -> TypeDescription:
    try:
        return msgspec.json.decode(text, type=TypeDescription)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise WireError(f"description of a type: {error}") from error


def _without_meaning(description: TypeDescription) -> TypeDescription:
    replace = msgspec.structs.replace
    structs = tuple(
        replace(one, fields=tuple(replace(field, meaning="") for field in one.fields))
        for one in description.structs
    )
    return replace(description, structs=structs)
