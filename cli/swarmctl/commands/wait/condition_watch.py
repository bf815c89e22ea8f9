"""A condition on one resource, and on others, with their newest values."""

from typing import Final

import msgspec

from swarmctl.resources.values import brief
from swarmware.errors import InvalidInput
from swarmware.mission import condition_parser
from swarmware.mission.condition import ConditionOperand
from swarmware.mission.field_path import Scalar, scalar_of
from swarmware.mission.vocabulary import Vocabulary
from swarmware.model import names
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree import TreeEntry

_VALUED: Final = frozenset({Kind.BOARD, Kind.EVENT, Kind.STREAM, Kind.SETTING})


class OperandValue(msgspec.Struct, frozen=True):
    """An operand of the condition with its newest value."""

    path: str
    field: str
    """Name of the field, `age()` for the age, or "" for the only field."""
    value: Scalar | None
    """Value of the field, or null without one."""
    age_s: float | None
    """Age of the resource's value, or null without a value or its clock."""


class ConditionWatch:
    """Evaluates a condition at each new value; times are arguments.

    Raises: MissionError with the place when it cannot be parsed.
    """

    def __init__(self, path: str, text: str) -> None:
        """`path`: global, of the resource whose fields have no path in the condition."""
        self._platform = names.split(path)[0] or ""
        self._expression = condition_parser.parse(text, own=path)
        self.paths = {path, *map(self._full, self._expression.resources())}
        """Global paths of all its resources."""
        self._vocabulary: dict[str, Resource] = {}
        self._classes: dict[str, type[msgspec.Struct]] = {}
        self._values: dict[str, msgspec.Struct] = {}
        self._stamps_ns: dict[str, int | None] = {}
        self._now_ns = 0

    def on_entry(self, entry: TreeEntry, cls: type[msgspec.Struct]) -> None:
        """A resource is known, with its type.

        Raises: InvalidInput with the column for a field or a value that the type never has.
        """
        # a condition in a mission has boards only, while an operator may wait for any value
        kind = Kind.BOARD if entry.kind in _VALUED else entry.kind
        local = names.split(entry.path)[1]
        self._vocabulary[entry.path] = Resource(path=local, kind=kind, type=entry.type, choices=entry.choices)
        self._classes[entry.type] = cls
        known = Vocabulary(self._vocabulary.values(), self._classes.__getitem__)
        for problem in known.examine(self._expression):
            if problem.severity == "error":
                raise InvalidInput(f"column {problem.at + 1} of {problem.message}")

    def on_value(self, path: str, value: msgspec.Struct, stamp_ns: int | None) -> None:
        """A value has arrived; `stamp_ns`: its stamp on the own clock, None if that is not known."""
        self._values[path], self._stamps_ns[path] = value, stamp_ns

    def holds(self, now_ns: int) -> bool:
        """Whether the condition holds now; not while a value is missing that it depends on."""
        self._now_ns = now_ns
        # an unknown result, such as of a missing value, is not a success
        return self._expression.holds(self) is True

    def next_change_s(self, now_ns: int) -> float | None:
        """Time until an age may change the condition without a new value, or None if no age will."""
        self._now_ns = now_ns
        return self._expression.next_change_s(self)

    def operands(self, now_ns: int) -> list[OperandValue]:
        """The values that the condition depends on, in its order."""
        self._now_ns = now_ns
        found: dict[tuple[str, str], OperandValue] = {}
        for one in self._expression.operands():
            path = self._full(one.path)
            operand = self._operand(path, one)
            found[path, operand.field] = operand
        return list(found.values())

    @staticmethod
    def shown(operands: list[OperandValue]) -> str:
        """Values on one line, with their ages."""
        parts = []
        for one in operands:
            name = one.field or one.path
            if one.value is None:
                shown = "has no value"
            elif one.age_s is None:
                shown = brief(one.value)
            elif one.field == "age()":
                shown = f"{one.age_s:.3f} s"
            else:
                shown = f"{brief(one.value)} ({one.age_s:.1f} s old)"
            parts.append(f"{name} {shown}")
        return ", ".join(parts)

    # -- the lookup of the condition

    def value(self, path: str, field: str) -> Scalar | None:
        """Newest value of a field, or None before the first value."""
        found = self._values.get(self._full(path))
        return None if found is None else scalar_of(found, field)

    def age_s(self, path: str) -> float | None:
        """Age of the newest value, or None without a value or its clock."""
        stamp_ns = self._stamps_ns.get(self._full(path))
        return None if stamp_ns is None else (self._now_ns - stamp_ns) / 1e9

    def _operand(self, path: str, one: ConditionOperand) -> OperandValue:
        age_s = self.age_s(path)
        if one.age:
            return OperandValue(path, "age()", age_s, age_s)
        return OperandValue(path, one.field, self.value(path, one.field), age_s)

    def _full(self, path: str) -> str:
        return path if path.startswith("/") else names.join(self._platform, path)
