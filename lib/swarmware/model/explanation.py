"""Explains an error of msgspec to the author of a document: the key, its value, and the expected value."""

import re
from collections.abc import Hashable, Iterator, Mapping
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

import msgspec

from swarmware.model.names import similar
from swarmware.model.toml_lines import KeyPath, key_text
from swarmware.model.validation_message import parse_validation_message

_STEP: Final = re.compile(r"\[(\.\.\.|\d+)\]|([^.\[\]]+)")
_MISSING: Final = re.compile(r"^Object missing required field `([^`]+)`")
_VALUE_LIMIT: Final = 80
"""Maximum characters of a value in a message."""
_NAMES: Final[dict[Any, str]] = {
    bool: "a boolean",
    int: "an integer",
    float: "a number",
    str: "a text",
    tuple: "an array",
    list: "an array",
}


class Explanation(msgspec.Struct, frozen=True):
    """Error in a document, with its place."""

    path: KeyPath
    """Keys and indices of the value, from the top, or () for the whole document."""
    error: str
    """The error, and the expected value."""
    value: str = ""
    """The value as text, or "" if it is missing or too long to show."""

    @property
    def text(self) -> str:
        """The key, the error, the expected value, and the value."""
        key = f"key {key_text(self.path)}: " if self.path else ""
        return f"{key}{self.error}" + (f" (it is {self.value})" if self.value else "")


def explain(message: str, raw: Any, cls: Any) -> Explanation:
    """Explain why this data is not of the class; `message`: of msgspec's ValidationError."""
    found = parse_validation_message(message)
    path, kind, value = _resolved(found.place, raw, cls)
    if found.unknown:
        known = _fields(kind)
        near = similar(found.unknown, known)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        return Explanation((*path, found.unknown), f"unknown; {hint}")
    # msgspec names the table, not the missing key, as the place
    if missing := _MISSING.match(found.text):
        expected = _name(_fields(kind).get(missing[1]))
        return Explanation((*path, missing[1]), f"missing; expected {expected}")
    # an error of the whole document: its value would repeat the document
    if not path:
        return Explanation(path, found.text)
    text = found.text[:1].lower() + found.text[1:]
    if "matching regex" in text and (described := _description(kind)):
        text = f"expected {described}"
    if choices := _choices(kind) if text.startswith("invalid enum value") else "":
        text += f"; expected one of {choices}"
    shown = repr(value)
    given = shown if len(shown) <= _VALUE_LIMIT and not isinstance(value, Mapping) else ""
    return Explanation(path, text, given)


def _resolved(place: str, raw: Any, cls: Any) -> tuple[KeyPath, Any, Any]:
    """Path, type and value at a place of msgspec, which names no key of a mapping."""
    path: KeyPath = ()
    kind = cls
    for index, name in _STEP.findall(place):
        step: Hashable
        if index == "...":
            kind = _member(kind, dict)
            # msgspec names no key of a mapping, so the first value that does not fit is searched
            step = _culprit(raw, kind)
        elif index:
            kind, step = _member(kind, tuple), int(index)
        else:
            kind, step = _fields(kind).get(name), name
        try:
            raw = raw[step]
        except (KeyError, IndexError, TypeError):
            raw = None
        path = (*path, step)
    return path, kind, raw


def _culprit(raw: Any, kind: Any) -> Hashable:
    """The first key of a mapping whose value is not of this type."""
    for key, value in raw.items() if isinstance(raw, Mapping) else ():
        try:
            msgspec.convert(value, kind, strict=True)
        except (msgspec.ValidationError, ValueError, TypeError):
            return str(key)
    return "…"


def _branches(kind: Any) -> Iterator[Any]:
    """The types of a union, without annotations."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in {Union, UnionType}:
        for branch in get_args(kind):
            yield from _branches(branch)
    else:
        yield kind


def _member(kind: Any, container: type) -> Any:
    """The type of the members of a container."""
    for branch in _branches(kind):
        origin, args = get_origin(branch), get_args(branch)
        if container is dict and origin is dict:
            return args[1]
        if container is tuple and origin in {tuple, list} and args:
            return args[0]
    return Any


def _fields(kind: Any) -> dict[str, Any]:
    """The fields of a Struct, by the name in a document."""
    for branch in _branches(kind):
        if isinstance(branch, type) and issubclass(branch, msgspec.Struct):
            return {field.encode_name: field.type for field in msgspec.structs.fields(branch)}
    return {}


def _choices(kind: Any) -> str:
    """The values of a Literal or an enumeration."""
    for branch in _branches(kind):
        if get_origin(branch) is Literal:
            return ", ".join(map(str, get_args(branch)))
        if isinstance(branch, type) and issubclass(branch, Enum):
            return ", ".join(str(one.value) for one in branch)
    return ""


def _description(kind: Any) -> str:
    """Description in the annotation of a type, or "" without one."""
    metas = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    return next((meta.description for meta in metas if getattr(meta, "description", None)), "")


def _name(kind: Any) -> str:
    if described := _description(kind):
        return described
    if choices := _choices(kind):
        return f"one of {choices}"
    if _fields(kind):
        return "an object"
    branch = next(_branches(kind), None)
    return _NAMES.get(get_origin(branch) or branch, "a value")
