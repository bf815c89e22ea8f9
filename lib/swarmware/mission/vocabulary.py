"""Checks the operands of conditions: resources of the templates, fields of their types, ranges of values."""

from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from functools import cache
from typing import Any, Final

import msgspec
import msgspec.inspect

from swarmware.errors import NotFound
from swarmware.mission.catalogue import WaitForSensor
from swarmware.mission.condition import (
    VALIDITY,
    Absent,
    Age,
    Both,
    Compare,
    ConditionExpression,
    Either,
    Field,
    Literal,
    Node,
    Not,
    Operand,
)
from swarmware.mission.condition_parser import parse
from swarmware.mission.field_path import steps
from swarmware.mission.field_type import (
    NUMBER,
    TEXT,
    TRUTH,
    FieldType,
    element,
    fields_of,
    parts_of,
    plain_type,
    present,
)
from swarmware.mission.finding import Severity
from swarmware.mission.model import MissionDefinition
from swarmware.mission.sensor_choice import SensorChoice, sought
from swarmware.model import template
from swarmware.model.config import share_dir
from swarmware.model.names import similar, split
from swarmware.model.resource import Kind, Resource
from swarmware.types import registry

_RATIO: Final = "_ratio"
"""Suffix of the name of a ratio from 0 to 1."""
_EQUAL: Final = ("==", "!=")
_VALUELESS: Final = {
    Kind.BRANCH: "a branch, which has no value",
    Kind.COMMAND: "a command, which has no value",
    Kind.FILE: "a file, whose value is not a number",
    Kind.STREAM: "a stream, which has no present value",
}


class Problem(msgspec.Struct, frozen=True):
    """An error or warning about a condition."""

    pointer: str
    """JSON pointer of the condition."""
    text: str
    """Text of the condition."""
    at: int
    """Offset in this text, from 0."""
    severity: Severity
    message: str


_Statement = tuple[int, Severity, str]
"""Offset in the condition, severity, message."""
_Looking = Generator[_Statement, None, FieldType | None]


_Known = dict[str, dict[str, Resource]]
"""Resources by local path and kind of platform; kind "" stands for every one."""


class Vocabulary:
    """Resources of each kind of platform, by local path."""

    def __init__(
        self,
        resources: Iterable[Resource] = (),
        types: Callable[[str], type[msgspec.Struct]] = registry.find,
        quantities: Callable[[], Collection[str]] = registry.quantities,
    ) -> None:
        """`types`: finds a payload type by its name; raises NotFound for an unknown type.

        `quantities`: names of the known types and of their fields.
        """
        self._quantities = quantities
        self._known: _Known = {}
        self._types = types
        self.add("", resources)

    def add(self, kind: str, resources: Iterable[Resource]) -> None:
        """Adds the resources of a template for one kind of platform, or for every kind if `kind` is ""."""
        for resource in resources:
            self._known.setdefault(resource.path, {})[kind] = resource

    def check(self, mission: MissionDefinition, kinds: Iterable[str] = (), own: str = "") -> list[Problem]:
        """Errors and warnings of conditions, for platforms of these kinds, or of any kind for ().

        `own`: the name of the platform itself, whose resources a path may name, too.
        """
        conditions = [(f"/requires/{n}", condition) for n, condition in enumerate(mission.requires)]
        conditions += [
            (f"{edge.pointer.removesuffix('/next')}/if", edge.condition)
            for block in mission.blocks.values()
            for edge in block.edges
            if edge.condition
        ]
        players = tuple(kinds)
        readers = [_TemplateReader(self._known, players, kind, own, self._types) for kind in players or ("",)]
        found = [problem for where in conditions for reader in readers for problem in reader.problems(*where)]
        for block in mission.blocks.values():
            if (params := sought(block.params)) is not None:
                found += self._sensors(block.pointer, params, readers, players)
        return list(dict.fromkeys(found))  # each kind of platform reports a common error once more

    def _sensors(
        self,
        pointer: str,
        params: WaitForSensor,
        readers: "list[_TemplateReader]",
        kinds: tuple[str, ...],
    ) -> Iterator[Problem]:
        """Warns of a sensor of no template; its condition must suit one of the sensors that are meant."""
        # templates may name types of packages that are installed only on the vehicle
        named = {resource.type for having in self._known.values() for resource in having.values()}
        known = named.union(self._quantities())
        if params.measures and params.measures not in known:
            near = similar(params.measures, known)
            hint = f"did you mean {near[0]!r}?" if near else "expected a type (Barometer) or a field of one"
            message = f"{params.measures!r} is measured by no sensor that is known here; {hint}"
            yield Problem(f"{pointer}/measures", params.measures, 0, "error", message)
            return
        choice = SensorChoice(params)
        meant = [
            path
            for path, having in self._known.items()
            for kind, resource in having.items()
            if (not kinds or kind in {"", *kinds}) and resource.kind not in _VALUELESS
            if choice.means(path, self._class(resource.type))
        ]
        if not meant:
            near = similar(params.sensor, self._known)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            message = f"{choice} is in no template{hint} (an application may provide it)"
            yield Problem(pointer, params.sensor, 0, "warning", message)
        if not meant or not params.until:
            return
        conditions = [parse(params.until, path) for path in meant]
        for reader in readers:
            found = [list(reader.problems(f"{pointer}/until", condition)) for condition in conditions]
            # the vehicle chooses the sensor: it suffices that the condition suits one of them
            if all(found):
                yield from found[0]

    def _class(self, name: str) -> type[msgspec.Struct] | None:
        """The type of that name, or None if it is not installed."""
        try:
            return self._types(name)
        except NotFound:
            return None

    def examine(self, condition: ConditionExpression) -> list[Problem]:
        """Errors and warnings of one condition, for platforms of any kind."""
        return list(_TemplateReader(self._known, (), "", "", self._types).problems("", condition))


class _TemplateReader:
    """Evaluates the types of one condition on a platform of one kind."""

    def __init__(
        self,
        known: _Known,
        kinds: tuple[str, ...],
        kind: str,
        own: str,
        types: Callable[[str], type[msgspec.Struct]],
    ) -> None:
        self._known = known
        self._kinds = kinds
        """Kinds of all platforms that may have the role."""
        self._kind = kind
        self._own = own
        self._types = types

    def problems(self, pointer: str, condition: ConditionExpression) -> Iterator[Problem]:
        """Errors and warnings of one condition."""
        for at, severity, message in self._truth(condition.node):
            yield Problem(pointer, condition.text, at, severity, f"condition {condition.text!r}: {message}")

    def _truth(self, node: Node) -> Iterator[_Statement]:
        if isinstance(node, Both | Either):
            yield from self._truth(node.left)
            yield from self._truth(node.right)
        elif isinstance(node, Not):
            yield from self._truth(node.inner)
        elif isinstance(node, Compare):
            yield from self._compare(node)
        elif isinstance(node, Absent):
            yield from self._operand(node.field)
        else:
            value = yield from self._operand(node)
            if value is not None and value.sort not in {"", TRUTH}:
                yield (
                    _at(node),
                    "error",
                    f"{value.name} is {value.sort}: expected a comparison with {value.sort}",
                )

    def _compare(self, node: Compare) -> Iterator[_Statement]:
        left = yield from self._operand(node.left)
        right = yield from self._operand(node.right)
        if left is None or right is None or not left.sort or not right.sort:
            return
        at = _at(node.left) if isinstance(node.right, Literal) else _at(node.right)
        if _of_validity(left, node.right) or _of_validity(right, node.left):
            if node.symbol not in _EQUAL:
                yield at, "error", f"{left.name} is {left.sort}: expected == or !=, not {node.symbol}"
            return
        if left.sort != right.sort:
            yield at, "error", f"{left.name} is {left.sort}, {right.name} is {right.sort}: expected the same"
        elif left.sort != NUMBER and node.symbol not in _EQUAL:
            yield at, "error", f"{left.name} is {left.sort}: expected == or !=, not {node.symbol}"
        else:
            for value, literal in ((left, node.right), (right, node.left)):
                if isinstance(literal, Literal):
                    yield from _literal(value, literal, at)

    def _operand(self, node: Operand) -> _Looking:
        if isinstance(node, Literal):
            sort = TRUTH if isinstance(node.value, bool) else TEXT if isinstance(node.value, str) else NUMBER
            return FieldType(repr(node.value) if sort == TEXT else str(node.value).lower(), sort)
        platform, local = split(node.path)
        having = self._known.get(local)
        if having is None:
            near = similar(local, self._known)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            yield (
                node.at,
                "warning",
                f"resource {node.path!r} is in no template{hint} (an application may provide it)",
            )
            return FieldType(node.path, NUMBER if isinstance(node, Age) else "")
        if self._kind and platform in {None, self._own}:
            yield from self._lacking(node, having)
            resource = having.get(self._kind) or having.get("")
            if resource is None:
                return FieldType(node.path, NUMBER if isinstance(node, Age) else "")
        else:
            resource = next(iter(having.values()))
        if resource.kind in _VALUELESS:
            yield node.at, "error", f"{node.path!r} is {_VALUELESS[resource.kind]}: expected a board"
            return None
        if isinstance(node, Age):
            return FieldType(f"age({node.path})", NUMBER)
        try:
            cls = self._types(resource.type)
        except NotFound:
            message = f"type {resource.type!r} of {node.path!r} is not installed: its fields are not checked"
            yield node.at, "warning", message
            return FieldType(node.path)
        return (yield from self._field(node, resource, cls))

    def _lacking(self, node: Age | Field, having: dict[str, Resource]) -> Iterator[_Statement]:
        """A resource that a platform of some of the kinds does not have."""
        lacking = [] if "" in having else [kind for kind in self._kinds if kind not in having]
        if lacking:
            # a role that several kinds may play is refused only if none of them has the resource
            severity: Severity = "error" if len(lacking) == len(self._kinds) else "warning"
            has, want = " or ".join(sorted(having)), " or ".join(lacking)
            yield node.at, severity, f"resource {node.path!r} belongs to a {has}: no {want} has it"

    def _field(self, node: Field, resource: Resource, cls: type[msgspec.Struct]) -> _Looking:
        fields = fields_of(cls)
        plain = len(fields) == 1
        found: Any = msgspec.inspect.type_info(cls)
        name = node.path
        # a condition may leave out the only field of a type
        if plain and (not node.field or node.field.startswith("[")):
            found = present(next(iter(fields.values())))
        elif not node.field:
            names = ", ".join(fields)
            yield node.at, "error", f"{node.path!r} is a {cls.__name__}: expected one of its fields ({names})"
            return None
        for step in steps(node.field):
            inner, refusal = element(found, step, name)
            if refusal:
                yield node.at, "error", refusal
                return None
            found, name = present(inner), f"{name}{step}"
        value = plain_type(name, found)
        if value is None:
            yield node.at, "error", f"{name} is {parts_of(found)}"
            return None
        if name.endswith(_RATIO):
            return msgspec.structs.replace(value, span=(0.0, 1.0))
        return msgspec.structs.replace(
            value,
            span=resource.range if plain else None,
            choices=resource.choices if plain and resource.choices else value.choices,
        )


@cache
def shipped() -> Vocabulary:
    """The resources of this installation's templates.

    Raises: ConfigError when a template is invalid.
    """
    folder = share_dir() / "templates"
    found = Vocabulary()
    for each in template.whole(folder):
        for kind in each.kinds or ("",):
            found.add(kind, each.resources)
    return found


def _of_validity(value: FieldType, literal: Operand) -> bool:
    """Whether a truth value is compared with `valid` or `invalid`."""
    return value.sort == TRUTH and isinstance(literal, Literal) and literal.value in VALIDITY


def _literal(value: FieldType, literal: Literal, at: int) -> Iterator[_Statement]:
    """Check a comparison of a value with a constant."""
    if isinstance(literal.value, str):
        if value.choices and literal.value not in value.choices:
            names = ", ".join(map(repr, value.choices))
            yield at, "error", f"{value.name} is never {literal.value!r}: expected one of {names}"
    elif not isinstance(literal.value, bool):
        share = value.span == (0.0, 1.0)
        if literal.percent and not share and not value.name[:1].isdigit():
            yield at, "error", f"{value.name} is not a ratio: expected a number without %"
        elif value.span and not value.span[0] <= literal.value <= value.span[1]:
            low, high = value.span
            # a typical mistake: `battery > 20` for a ratio
            hint = f", or {literal.value:g} %" if share and 1 < literal.value <= 100 else ""
            yield at, "error", f"{value.name} is never {literal.value:g}: expected {low:g} to {high:g}{hint}"


def _at(node: Operand) -> int:
    return 0 if isinstance(node, Literal) else node.at
