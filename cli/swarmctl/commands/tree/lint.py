"""Checks of templates and of the live tree: units, ranges, types, names, owners."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Protocol

import msgspec

from swarmctl.resources.classes import payload_class
from swarmctl.resources.listing import listing
from swarmctl.session.session import Session
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import ConfigError, InvalidInput, SwarmError
from swarmware.model import names, template
from swarmware.model.open_enum import OpenEnum
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.tree import Quality
from swarmware.types.units import UNITS

KNOWN_UNITS: Final = frozenset(
    {unit for _, unit in UNITS} | {"", "1", "bit", "kg·m²", "N·m", "m²", "m³", "mAh"}
)
"""Units by SI symbol; `1` for a ratio or a count."""
REALS: Final = frozenset({"Float"})
NUMBERS: Final = REALS | {"Int"}
TEXTS: Final = frozenset({"Text"})
PLACES: Final = {Kind.SETTING: ("config",), Kind.COMMAND: ("cmd", "sys")}
"""Permitted first segments of the paths of a kind."""
_SEGMENT: Final = re.compile(r"[a-z][a-z0-9_]*\Z")


class LintLevel(OpenEnum):
    """Weight of a finding."""

    ERROR = "error"
    WARNING = "warning"


class TreeFinding(msgspec.Struct, frozen=True):
    """An error or warning about a template or the tree."""

    level: LintLevel
    where: str
    """Template such as `multirotor`, or platform."""
    path: str
    """Local path, or "" for the whole template."""
    text: str
    """Finding and expectation as text."""


class TreeLint(msgspec.Struct, frozen=True):
    """Findings of the checks."""

    findings: list[TreeFinding]
    checked: int
    """Number of checked resources."""


class Descriptor(Protocol):
    """Common interface of a `Resource` and an entry of the live tree."""

    @property
    def path(self) -> str: ...
    @property
    def kind(self) -> Kind: ...
    @property
    def type(self) -> str: ...
    @property
    def reply(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def range(self) -> tuple[float, float] | None: ...
    @property
    def choices(self) -> tuple[str, ...]: ...
    @property
    def owner(self) -> str: ...


def descriptor_findings(where: str, local: str, one: Descriptor) -> Iterator[TreeFinding]:
    """Findings about one descriptor."""

    def error(text: str) -> TreeFinding:
        return TreeFinding(LintLevel.ERROR, where, local, text)

    def warning(text: str) -> TreeFinding:
        return TreeFinding(LintLevel.WARNING, where, local, text)

    for segment in local.split("/"):
        if not _SEGMENT.match(segment):
            yield error(f"name {segment!r}: expected lower-case words with underscores")
    places = PLACES.get(one.kind, ())
    # a warning only, as the tree serves it at any path
    if places and local.partition("/")[0] not in places:
        yield warning(f"a {one.kind} outside {' and '.join(f'{place}/' for place in places)}")
    if one.unit not in KNOWN_UNITS:
        yield error(f"unit {one.unit!r}: not known; expected an SI symbol, such as m, m/s or 1/s")
    if one.type in REALS and not one.unit:
        yield warning("a number without a unit; expected one, `1` for a ratio")
    if one.range is not None and one.type not in NUMBERS:
        yield error(f"range of a {one.type}; expected it of a Float or Int only")
    if one.choices and one.type not in TEXTS:
        yield error(f"choices of a {one.type}; expected them of a Text only")
    if one.kind is Kind.SETTING and one.type in NUMBERS and one.range is None:
        yield warning("a setting without a range; expected the permitted minimum and maximum")
    if one.kind not in {Kind.BRANCH, Kind.SETTING} and not one.owner:  # the tree service owns all settings
        yield warning("no owner; expected the name of the application that provides it")


def contradictions(descriptors: Iterable[tuple[str, str, Descriptor]]) -> Iterator[TreeFinding]:
    """Resources whose kind, type or unit differs between places, from `(where, local path, descriptor)`."""
    first: dict[str, tuple[str, Descriptor]] = {}
    for where, local, one in descriptors:
        place, known = first.setdefault(local, (where, one))
        for field in ("kind", "type", "unit"):
            mine, other = getattr(one, field), getattr(known, field)
            if mine != other:
                text = f"{field} {str(mine)!r}, but {str(other)!r} of {place}; expected the same of one path"
                yield TreeFinding(LintLevel.ERROR, where, local, text)


def template_findings(folder: Path) -> tuple[list[TreeFinding], int]:
    """Findings about all templates of a folder, and the number of their resources."""
    found: list[TreeFinding] = []
    seen: list[tuple[str, str, Descriptor]] = []
    reported: set[tuple[str, str]] = set()
    for name in template.names_in(folder):
        try:
            resources = template.load(name, folder).resources
        except ConfigError as error:
            found.append(TreeFinding(LintLevel.ERROR, name, "", str(error)))
            continue
        for one in resources:
            seen.append((name, one.path, one))
            findings = [*descriptor_findings(name, one.path, one), *_types_not_installed(name, one)]
            # templates inherit resources, so the same finding would be reported for each heir
            found += [item for item in findings if (item.path, item.text) not in reported]
            reported |= {(item.path, item.text) for item in findings}
    return [*found, *contradictions(seen)], len(seen)


def _types_not_installed(where: str, one: Descriptor) -> Iterator[TreeFinding]:
    for name in filter(None, (one.type, one.reply)):
        if not registry.installed(name):
            text = (
                f"type {name!r}: not installed here; expected a type of Swarmware or of an installed package"
            )
            yield TreeFinding(LintLevel.WARNING, where, one.path, text)


async def live_findings(session: Session, pattern: str) -> tuple[list[TreeFinding], int]:
    """Findings about the resources that match, as the joined node knows them, and their number."""
    entries = (await listing(session, pattern)).entries
    found: list[TreeFinding] = []
    seen: list[tuple[str, str, Descriptor]] = []
    for entry in entries:
        platform, local = names.split(entry.path)
        where = platform or session.here
        seen.append((where, local, entry))
        found += descriptor_findings(where, local, entry)
        if entry.quality is Quality.LOST:
            text = f"its owner {entry.owner or '?'} has ended or cannot be reached"
            found.append(TreeFinding(LintLevel.WARNING, where, local, text))
        for name in filter(None, (entry.type, entry.reply)):
            if not await _is_described(session, where, name):
                text = f"type {name!r}: neither installed here nor described by {where}"
                found.append(TreeFinding(LintLevel.ERROR, where, local, text))
    return [*found, *contradictions(seen)], len(seen)


async def _is_described(session: Session, platform: str, name: str) -> bool:
    try:
        return await payload_class(session, platform, name) is not None
    except SwarmError:
        return False  # an invalid description


async def lint_live(session: Session, pattern: str, templates: Path | None) -> None:
    """Prints the findings about the live tree, and about a folder of templates.

    Raises: InvalidInput when there is an error among them; NotFound when nothing matches.
    """
    found, checked = await live_findings(session, pattern)
    if templates is not None:
        of_files, count = template_findings(templates)
        found, checked = [*of_files, *found], checked + count
    show(session.out, found, checked)


def show(out: Output, found: list[TreeFinding], checked: int) -> None:
    """Prints findings, the errors first. Raises: InvalidInput when there is an error among them."""
    found = sorted(found, key=lambda one: one.level is not LintLevel.ERROR)
    errors = sum(one.level is LintLevel.ERROR for one in found)
    if out.settings.structured:
        out.document(TreeLint(found, checked))
    elif found:
        columns = [Column("LEVEL"), Column("WHERE"), Column("PATH"), Column("FINDING", wraps=True)]
        out.table(columns, [(one.level, one.where, one.path, one.text) for one in found])
    out.say(f"{checked} resources checked: {errors} errors, {len(found) - errors} warnings")
    if errors:
        raise InvalidInput(f"tree: {errors} errors in {checked} resources; expected none")
