"""Differences of two trees, each a dump or the present tree of a platform or pattern."""

import asyncio
from collections.abc import Container
from pathlib import Path
from typing import Any, Final

import msgspec

from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commands.tree.snapshot import DumpedResource, TreeSnapshot, read_snapshot, take_snapshot
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.model import names
from swarmware.model.resource import Kind
from swarmware.types.json_form import json_form

DESCRIPTOR: Final = ("kind", "type", "reply", "unit", "range", "choices", "access", "rate_hz", "owner")
"""Fields of a resource that are compared in addition to its value."""
RESOURCE: Final = "resource"
VALUE: Final = "value"


class TreeDifference(msgspec.Struct, frozen=True):
    """A field of a resource that differs."""

    path: str
    """Global path, or the local one if two different platforms are compared."""
    field: str
    """Name of the differing field: `value`, a field of the descriptor, or `resource` if one side lacks it."""
    here: Any
    there: Any


class TreeDiff(msgspec.Struct, frozen=True):
    """Differences of two trees."""

    differences: list[TreeDifference]
    here: str
    """File or pattern of the first side."""
    there: str


async def diff(session: Session, one: str, other: str, *, values: bool) -> None:
    """Prints the differences of two files, platforms or patterns, or of a file and the tree without `other`.

    `values`: compare the values of all resources, not only of settings.
    Raises: ConfigError for a file that is not a dump; NotFound when nothing matches.
    """
    valued = VALUED if values else frozenset({Kind.SETTING})
    if other:
        here, there = await asyncio.gather(_side(session, one, valued), _side(session, other, valued))
    else:
        # first the file: its pattern names the resources that are compared with it
        here = await _side(session, one, valued)
        other = here.pattern
        there = await _side(session, other, valued)
    found = differences(here, there, values=values)
    if session.settings.structured:
        session.out.document(TreeDiff(found, one, other))
        return
    columns = [Column("PATH"), Column("FIELD"), Column(one.strip("/")), Column(other.strip("/"))]
    rows = [(d.path, d.field, _cell(d.here), _cell(d.there)) for d in found]
    session.out.table(columns, rows, empty=f"{one} and {other}: no difference")


async def _side(session: Session, text: str, valued: Container[str]) -> TreeSnapshot:
    """The content of a file, else the present tree of a platform or a pattern."""
    if is_file(text):
        return read_snapshot(text)
    # a bare word may be a platform, or a resource of the joined node
    bare = not text.startswith("/") and text in await session.platforms()
    return await take_snapshot(session, f"/{text}" if bare else text, valued)


def is_file(text: str) -> bool:
    """Whether a side names a file, existing or not, rather than a platform or a pattern."""
    return text.endswith((".toml", ".json")) or Path(text).is_file()


def differences(here: TreeSnapshot, there: TreeSnapshot, *, values: bool) -> list[TreeDifference]:
    """Differences in natural order of paths, which are local if two different platforms are compared."""
    # otherwise every path of two platforms would differ by its first segment
    local = len(here.platforms) == len(there.platforms) == 1 and here.platforms != there.platforms
    left, right = _by_path(here, local=local), _by_path(there, local=local)
    found: list[TreeDifference] = []
    for path in sorted({*left, *right}, key=names.natural):
        one, other = left.get(path), right.get(path)
        if one is None or other is None:
            found.append(TreeDifference(path, RESOURCE, _kind(one), _kind(other)))
            continue
        pairs = ((field, getattr(one, field), getattr(other, field)) for field in DESCRIPTOR)
        found += [TreeDifference(path, field, mine, its) for field, mine, its in pairs if mine != its]
        if (values or one.kind == Kind.SETTING) and not _same(one.value, other.value):
            found.append(TreeDifference(path, VALUE, one.value, other.value))
    return found


def _by_path(found: TreeSnapshot, *, local: bool) -> dict[str, DumpedResource]:
    return {names.split(one.path)[1] if local else one.path: one for one in found.resources}


def _kind(one: DumpedResource | None) -> str | None:
    return None if one is None else f"{one.kind} {one.type}".rstrip()


def _same(one: Any, other: Any) -> bool:
    """Whether two values are equal, even if one of them went through JSON or TOML."""
    return bool(one == other or _canonical(one) == _canonical(other))


def _canonical(value: Any) -> Any:
    if isinstance(value, dict):
        # TOML has no null, so a dump leaves such keys out
        return {key: _canonical(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return ["" if item is None else _canonical(item) for item in value]
    if isinstance(value, int) and not isinstance(value, bool):
        # a file may have 1 for 1.0; beyond 2**53 a float would make different integers equal
        return str(value) if abs(value) > 2**53 else float(value)
    return value.isoformat() if hasattr(value, "isoformat") else value


def _cell(value: Any) -> str | None:
    return None if value is None or value == "" else brief(json_form(value))
