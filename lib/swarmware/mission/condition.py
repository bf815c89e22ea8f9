"""Conditions on resource values: their parts, and what they yield for present values."""

import operator
from collections.abc import Callable, Iterator
from typing import Final, Protocol

import msgspec

from swarmware.mission.field_path import Scalar

VALIDITY: Final = {"valid": True, "invalid": False}
"""Words for a truth value in a comparison: `health/state.sensors.gnss == "valid"`."""

CROSSED_S: Final = 0.001
"""Time after which an age that reached a limit is beyond it; timers of the event loop are as precise."""

COMPARISONS: Final[dict[str, Callable[[float | str, float | str], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
"""Comparisons, by symbol."""


class Lookup(Protocol):
    """Source of present values for a condition."""

    def value(self, path: str, field: str) -> Scalar | None:
        """Newest value of the resource's field (empty: its only field), or None without a value."""
        ...

    def age_s(self, path: str) -> float | None:
        """Age of the newest value, or None without a value."""
        ...


class Literal(msgspec.Struct, frozen=True, tag=True):
    """A constant in the text of the condition."""

    value: Scalar
    percent: bool = False
    """The number was written with %."""


class Field(msgspec.Struct, frozen=True, tag=True):
    """A field of a resource, as an operand."""

    path: str
    field: str
    at: int = 0
    """Offset in the text, from 0."""


class Age(msgspec.Struct, frozen=True, tag=True):
    """Age of a resource in seconds."""

    path: str
    at: int = 0
    """Offset of its path in the text, from 0."""


class Absent(msgspec.Struct, frozen=True, tag=True):
    """Holds while a field has no value: never published, or an element that its map or list does not have."""

    field: Field


class Compare(msgspec.Struct, frozen=True, tag=True):
    """Left and right side of a comparison."""

    symbol: str
    left: "Operand"
    right: "Operand"


class Not(msgspec.Struct, frozen=True, tag=True):
    """Holds when the inner condition does not."""

    inner: "Node"


class Both(msgspec.Struct, frozen=True, tag=True):
    """Holds when both conditions hold."""

    left: "Node"
    right: "Node"


class Either(msgspec.Struct, frozen=True, tag=True):
    """Holds when at least one condition holds."""

    left: "Node"
    right: "Node"


class ConditionOperand(msgspec.Struct, frozen=True):
    """A field or an age that a condition depends on."""

    path: str
    field: str = ""
    age: bool = False


Operand = Literal | Field | Age
Node = Compare | Not | Both | Either | Absent | Literal | Field | Age


class ConditionExpression(msgspec.Struct, frozen=True):
    """A parsed condition with its text."""

    text: str
    node: Node

    def holds(self, lookup: Lookup) -> bool | None:
        """Whether the condition holds now, or None if a needed value is missing (Kleene's logic)."""
        return _truth(self.node, lookup)

    def resources(self) -> frozenset[str]:
        """Paths of the resources in the condition."""
        return frozenset(operand.path for operand in self.operands())

    def operands(self) -> list[ConditionOperand]:
        """The fields and ages in the condition, in their order."""
        return [
            ConditionOperand(one.path, age=True)
            if isinstance(one, Age)
            else ConditionOperand(one.path, one.field)
            for one in _nodes(self.node)
            if isinstance(one, Age | Field)
        ]

    def values(self, lookup: Lookup) -> str:
        """Present values of its fields and ages, for a record: `power/battery.remaining_ratio 0.12`."""
        found: dict[str, None] = {}
        for one in _nodes(self.node):
            if isinstance(one, Age):
                age_s = lookup.age_s(one.path)
                found[f"age({one.path}) {'unknown' if age_s is None else f'{age_s:.1f} s'}"] = None
            elif isinstance(one, Field):
                value = lookup.value(one.path, one.field)
                name = f"{one.path}.{one.field}" if one.field else one.path
                shown = f"{value:.4g}" if isinstance(value, float) else value
                found[f"{name} {'unknown' if value is None else shown}"] = None
        return ", ".join(found)

    def next_change_s(self, lookup: Lookup) -> float | None:
        """Time until an age may change the result without a new value, or None if no age can."""
        comparisons = (node for node in _nodes(self.node) if isinstance(node, Compare))
        ahead = [after_s for node in comparisons if (after_s := _crossing_s(node, lookup)) is not None]
        return min(ahead, default=None)


def _crossing_s(node: Compare, lookup: Lookup) -> float | None:
    """Time until the age on one side of a comparison is just beyond the value on the other."""
    ages, others = (node.left, node.right), (node.right, node.left)
    for age, other in zip(ages, others, strict=True):
        if isinstance(age, Age) and not isinstance(other, Age):
            age_s, limit_s = lookup.age_s(age.path), _operand_value(other, lookup)
            if age_s is not None and isinstance(limit_s, int | float) and limit_s >= age_s:
                return limit_s - age_s + CROSSED_S
    return None


def _nodes(node: Node) -> Iterator[Node]:
    """A condition and all its parts, in their order."""
    yield node
    if isinstance(node, Not):
        yield from _nodes(node.inner)
    elif isinstance(node, Absent):
        yield node.field
    elif isinstance(node, Both | Either | Compare):
        yield from _nodes(node.left)
        yield from _nodes(node.right)


def _operand_value(node: Operand, lookup: Lookup) -> Scalar | None:
    if isinstance(node, Literal):
        return node.value
    if isinstance(node, Age):
        return lookup.age_s(node.path)
    return lookup.value(node.path, node.field)


def _truth(node: Node, lookup: Lookup) -> bool | None:
    if isinstance(node, Compare):
        left, right = _operand_value(node.left, lookup), _operand_value(node.right, lookup)
        if isinstance(left, bool) and isinstance(right, str):
            right = VALIDITY.get(right)
        elif isinstance(right, bool) and isinstance(left, str):
            left = VALIDITY.get(left)
        if left is None or right is None or isinstance(left, str) != isinstance(right, str):
            return None
        return COMPARISONS[node.symbol](left, right)
    if isinstance(node, Absent):
        return lookup.value(node.field.path, node.field.field) is None
    if isinstance(node, Not):
        inner = _truth(node.inner, lookup)
        return None if inner is None else not inner
    if isinstance(node, Both | Either):
        decisive = isinstance(node, Either)
        left_truth, right_truth = _truth(node.left, lookup), _truth(node.right, lookup)
        # One false side decides `and`, one true side decides `or`, even if the other value is unknown
        # (Kleene).
        if decisive in (left_truth, right_truth):
            return decisive
        return None if left_truth is None or right_truth is None else not decisive
    value = _operand_value(node, lookup)
    return value if isinstance(value, bool) else None
