"""Explains an error of msgspec to the author of a document: the key, its value, and what was expected."""

import re
from collections.abc import Hashable, Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin

import msgspec

from swarmware.model.misfit import misfit
from swarmware.model.similar import similar
from swarmware.model.toml_lines import KeyPath, key_text

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
    """What is invalid in a document."""

    path: KeyPath
    """Keys and indices of the value, from the top."""
    text: str
    """The key, the error, and what was expected."""


def explain(message: str, raw: Any, cls: Any) -> Explanation:
    """Explain why this data is not of the class; `message`: of msgspec's ValidationError."""
    found = misfit(message)
    path, kind, value = _resolved(found.place, raw, cls)
    if found.unknown:
        path, known = (*path, found.unknown), sorted(_fields(kind))
        near = similar(found.unknown, known)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(_fields(kind))}"
        return Explanation(path, f"key {key_text(path)}: unknown; {hint}")
    if missing := _MISSING.match(found.text):
        path = (*path, missing[1])
        return Explanation(
            path, f"key {key_text(path)}: missing; expected {_name(_fields(kind).get(missing[1]))}"
        )
    if not path:
        return Explanation(path, found.text)
    text = found.text[:1].lower() + found.text[1:]
    if "matching regex" in text and (described := _description(kind)):
        text = f"expected {described}"
    shown = repr(value)
    given = f" (it is {shown})" if len(shown) <= _VALUE_LIMIT and not isinstance(value, Mapping) else ""
    return Explanation(path, f"key {key_text(path)}: {text}{given}")


def _resolved(place: str, raw: Any, cls: Any) -> tuple[KeyPath, Any, Any]:
    """Path, type and value at a place of msgspec, which names no key of a mapping."""
    path: KeyPath = ()
    kind = cls
    for index, name in _STEP.findall(place):
        step: Hashable
        if index == "...":
            kind = _member(kind, dict)
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


def _description(kind: Any) -> str:
    """What the annotation of a type says that its values are; empty: nothing."""
    metas = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    return next((meta.description for meta in metas if getattr(meta, "description", None)), "")


def _name(kind: Any) -> str:
    if described := _description(kind):
        return described
    branch = next(_branches(kind), None)
    return _NAMES.get(get_origin(branch) or branch, "a value")
