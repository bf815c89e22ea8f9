"""Fields, types, units, ranges and meaning of a payload type, or of the types of a resource."""

import re
from typing import Any, Final

import msgspec

from swarmctl.resources.access import entry_of
from swarmctl.resources.classes import described, described_anywhere
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.wrapping import wrapped
from swarmware.errors import NotFound
from swarmware.model.names import split
from swarmware.types.description import FieldDescription, StructDescription
from swarmware.types.tree import TreeEntry
from swarmware.types.units import unit_of

_TYPE_NAME: Final = re.compile(r"[A-Z][A-Za-z0-9_]*\Z")
INDENT: Final = "    "


class ShownField(msgspec.Struct, frozen=True):
    """One field of a type."""

    name: str
    type: str
    """Type as in Python, such as `float | None` or `list[Point]`; `Any` if only the owner knows it."""
    unit: str
    required: bool
    default: Any
    """Default, or null if the default is null or the field is required."""
    low: int | float | None
    high: int | float | None
    """Largest permitted number; `low` and `high` are both included."""
    choices: list[str]
    """Permitted texts, or [] for any text."""
    meaning: str


class ShownStruct(msgspec.Struct, frozen=True):
    """A type with its fields in their order."""

    name: str
    meaning: str
    fields: list[ShownField]


class ShownTypes(msgspec.Struct, frozen=True):
    """The types of a resource, or one type, and the types of their fields."""

    types: list[ShownStruct]
    resource: TreeEntry | None = None
    """The named resource, whose unit, range, access and reply hold for its value."""


async def print_type(session: Session, name: str) -> None:
    """Prints the description of a type by its name, or of the types of a resource by its path.

    Raises: NotFound, NoAnswer.
    """
    if _TYPE_NAME.match(name):
        entry, found = None, [await described_anywhere(session, name)]
    else:
        entry = await entry_of(session, name)
        platform = split(entry.path)[0] or session.here
        wanted = [type_name for type_name in (entry.type, entry.reply) if type_name]
        if not wanted:
            raise NotFound(f"{entry.path}: a {entry.kind} has no type; expected a resource with a value")
        found = [await described(session, platform, type_name) for type_name in wanted]
    # request and reply may have types in common
    structs = {one.name: one for description in found for one in description.structs}
    if session.settings.structured:
        session.out.document(ShownTypes([_shown(one, entry) for one in structs.values()], entry))
        return
    lines = [] if entry is None else [*_resource_lines(entry, session.out.width), ""]
    for one in structs.values():
        lines += [*_struct_lines(_shown(one, entry), session.out.width), ""]
    session.out.text(*lines[:-1])


def _shown(one: StructDescription, entry: TreeEntry | None) -> ShownStruct:
    return ShownStruct(one.name, one.meaning, [_shown_field(field, one, entry) for field in one.fields])


def _shown_field(field: FieldDescription, one: StructDescription, entry: TreeEntry | None) -> ShownField:
    unit = unit_of(field.name, whole=field.whole)
    low, high, choices = field.low, field.high, re.findall(r"'([^']*)'", field.type)
    if entry is not None and one.name == entry.type and len(one.fields) == 1:  # the resource is more precise
        unit = entry.unit or unit
        low, high = entry.range or (low, high)
        choices = list(entry.choices) or choices
    default = msgspec.msgpack.decode(field.default) if field.default else None
    return ShownField(
        field.name,
        field.type,
        "" if unit == "1" else unit,
        field.required,
        default,
        low,
        high,
        choices,
        field.meaning,
    )


def _resource_lines(entry: TreeEntry, width: int | None) -> list[str]:
    facts = [f"{entry.kind} of {entry.owner or 'no running application'}", f"access {entry.access}"]
    if entry.unit:
        facts.append(f"unit {entry.unit}")
    if entry.range is not None:
        facts.append(f"range {entry.range[0]:g} to {entry.range[1]:g}")
    if entry.choices:
        facts.append(f"one of {', '.join(entry.choices)}")
    if entry.rate_hz:
        facts.append(f"declared rate {entry.rate_hz:g} Hz")
    if entry.reply:
        facts.append(f"request {entry.type}, reply {entry.reply}")
    if entry.confirm:
        facts.append(f"asks for a confirmation: {entry.confirm}")
    lines = wrapped(f"{entry.path}: {', '.join(facts)}", width, "", INDENT)
    return lines + (wrapped(entry.description, width, INDENT, INDENT) if entry.description else [])


def _struct_lines(one: ShownStruct, width: int | None) -> list[str]:
    head = f"{one.name}: " if one.meaning else one.name
    lines = wrapped(one.meaning, width, head, INDENT)
    longest = max((len(field.name) for field in one.fields), default=0)
    for field in one.fields:
        lines += wrapped(_field_text(field), width, f"{INDENT}{field.name:<{longest}}  ", INDENT * 3)
    return lines


def _field_text(field: ShownField) -> str:
    facts = [field.type]
    if field.unit:
        facts.append(field.unit)
    if field.low is not None or field.high is not None:
        low = "" if field.low is None else f"{field.low:g}"
        high = "" if field.high is None else f"{field.high:g}"
        facts.append(f"{low}..{high}")
    if not field.required:
        shown = brief(field.default) or "''"
        facts.append("optional" if field.default is None else f"default {shown}")
    return ", ".join(facts) + (f": {field.meaning}" if field.meaning else "")
