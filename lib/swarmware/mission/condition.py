"""Conditions on resource values: `battery < 80 % or age(nav/pose) > 1`.

Grammar: or, and, not, comparisons (< <= > >= == !=), parentheses, absent(path.field); operands are numbers
(with % as a hundredth), 'text' or "text", true, false, resource paths with an optional field, age(path) in
seconds. A field is a name, or an element of a map or list: `health/state.sensors["sensor/gnss"]`, `[0]`; the
end of a path names an element of a map as well, and a truth value may be compared with the words valid and
invalid: `health/state.sensors.gnss == "valid"`.
In a condition on one resource names without a path are its fields, and age() is its age.
"""

import operator
import re
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Final, Protocol

import msgspec

from swarmware.errors import MissionError
from swarmware.mission.field_path import STEPS_PATTERN, Scalar

SHORT_NAMES: Final = {
    "battery": ("power/battery", "remaining_ratio"),
    "batterylevel": ("power/battery", "remaining_ratio"),
    "altitude": ("nav/pose", "z_m"),
}
"""Short names for resources that every vehicle has."""

VALIDITY: Final = {"valid": True, "invalid": False}
"""Words for a truth value in a comparison: `health/state.sensors.gnss == "valid"`."""

LENGTH_LIMIT: Final = 500
"""Maximum characters of one condition."""
DEPTH_LIMIT: Final = 20
"""Maximum nesting of parentheses and `not`."""

CROSSED_S: Final = 0.001
"""Time after which an age that reached a limit is beyond it; timers of the event loop are as precise."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)(?P<percent>\s*%)?"
    r"|'(?P<text>[^']*)'|\"(?P<quoted>[^\"]*)\""
    rf"|(?P<path>/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*)(?P<steps>{STEPS_PATTERN})"
    r"|(?P<symbol><=|>=|==|!=|<|>|\(|\)))"
)

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
        """Newest value of the resource's field (empty: its only field); None without a value."""
        ...

    def age_s(self, path: str) -> float | None:
        """Age of the newest value; None when there is none."""
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
        """Whether the condition holds now; None when a needed value is missing (Kleene's logic)."""
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

    def next_change_s(self, lookup: Lookup) -> float | None:
        """Time until an age may change the result without a new value; None: none will."""
        comparisons = (node for node in _nodes(self.node) if isinstance(node, Compare))
        ahead = [after_s for node in comparisons if (after_s := _crossing_s(node, lookup)) is not None]
        return min(ahead, default=None)


def parse(text: str, own: str = "") -> ConditionExpression:
    """Parse the text of a condition.

    `own`: path of the resource whose fields the names without a path are; empty: they are short names.
    Raises: MissionError with the place in the text and what was expected.
    """
    if len(text) > LENGTH_LIMIT:
        raise MissionError(f"condition of {len(text)} characters: expected at most {LENGTH_LIMIT}")
    reader = _ConditionParser(text, own)
    node = reader.either(0)
    if reader.kind is not TokenKind.END:
        raise reader.error("and, or, or the end")
    return ConditionExpression(text, node)


class TokenKind(StrEnum):
    """Kinds of tokens; the values are the groups of the expression that finds them."""

    NUMBER = "number"
    TEXT = "text"
    PATH = "path"
    SYMBOL = "symbol"
    END = "end"
    OTHER = "other"
    """No token."""


class _ConditionParser:
    """Recursive descent over the tokens."""

    def __init__(self, text: str, own: str) -> None:
        self._text = text
        self._own = own
        self._at = 0
        self.kind = TokenKind.OTHER
        self.word = ""
        self._steps = ""
        """Field path behind the path of a resource."""
        self._number = 0.0
        self._percent = False
        self._begin = 0
        self._advance()

    def error(self, expected: str) -> MissionError:
        place = f"at {self.word!r}" if self.kind is not TokenKind.END else "at its end"
        return MissionError(
            f"condition {self._text!r} {place}, column {self._begin + 1}: expected {expected}"
        )

    def _advance(self) -> None:
        rest = self._text[self._at :]
        self._begin = self._at + len(rest) - len(rest.lstrip())
        if not rest.strip():
            self.kind, self.word = TokenKind.END, ""
            return
        found = _TOKEN.match(self._text, self._at)
        if found is None:
            before, self.kind, self.word = self.kind, TokenKind.OTHER, rest.strip()[:10]
            if before is TokenKind.PATH and self.word.startswith("["):
                raise self.error('an index such as [0], or a key in quotes such as ["sensor/gnss"]')
            raise self.error("a number, a resource path, 'text' or a comparison")
        self._at = found.end()
        self._steps = found["steps"] or ""
        if found["path"] is not None:
            self.kind, self.word = TokenKind.PATH, found["path"]
            return
        if found["quoted"] is not None:
            self.kind, self.word = TokenKind.TEXT, found["quoted"]
            return
        self.kind = TokenKind.NUMBER if found["number"] is not None else TokenKind(found.lastgroup or "")
        if self.kind is TokenKind.NUMBER:
            self.word = found[0].strip()
            self._percent = found["percent"] is not None
            self._number = float(found["number"]) / (100.0 if self._percent else 1.0)
        else:
            self.word = found[self.kind]

    def _take(self, kind: TokenKind, word: str) -> bool:
        if self.kind == kind and self.word == word and not self._steps:
            self._advance()
            return True
        return False

    def _take_call(self, name: str) -> bool:
        """Takes the name of a function and its opening parenthesis."""
        called = self.kind is TokenKind.PATH and self.word == name and not self._steps
        if not called or not self._text[self._at :].lstrip().startswith("("):
            return False
        self._advance()
        return self._take(TokenKind.SYMBOL, "(")

    def _close(self) -> None:
        if not self._take(TokenKind.SYMBOL, ")"):
            raise self.error(")")

    def either(self, depth: int) -> Node:
        node = self._both(depth)
        while self._take(TokenKind.PATH, "or"):
            node = Either(node, self._both(depth))
        return node

    def _both(self, depth: int) -> Node:
        node = self._not(depth)
        while self._take(TokenKind.PATH, "and"):
            node = Both(node, self._not(depth))
        return node

    def _not(self, depth: int) -> Node:
        if depth > DEPTH_LIMIT:
            raise self.error(f"at most {DEPTH_LIMIT} nested parts")
        if self._take(TokenKind.PATH, "not"):
            return Not(self._not(depth + 1))
        if self._take(TokenKind.SYMBOL, "("):
            node = self.either(depth + 1)
            self._close()
            return node
        if self._take_call("absent"):
            if self.kind is not TokenKind.PATH or not isinstance(field := self._operand(), Field):
                raise self.error("a field of a resource, such as nav/pose.x_m")
            self._close()
            return Absent(field)
        left = self._operand()
        if self.kind is TokenKind.SYMBOL and self.word in COMPARISONS:
            symbol = self.word
            self._advance()
            return Compare(symbol, left, self._operand())
        if isinstance(left, Literal) and not isinstance(left.value, bool):
            raise self.error("a comparison")
        return left

    def _operand(self) -> Operand:
        kind, word, steps, begin = self.kind, self.word, self._steps, self._begin
        number, percent = self._number, self._percent
        is_value = kind in {TokenKind.NUMBER, TokenKind.TEXT, TokenKind.PATH}
        if not is_value or (kind is TokenKind.PATH and word in {"and", "or", "not"}):
            raise self.error("a number, a resource path or 'text'")
        if self._take_call("age"):
            return self._age()
        self._advance()
        if kind is TokenKind.NUMBER:
            return Literal(number, percent)
        if kind is TokenKind.TEXT:
            return Literal(word)
        if word in {"true", "false"} and not steps:
            return Literal(word == "true")
        if self._own and "/" not in word:
            return Field(self._own, word + steps, begin)
        if word.lower() in SHORT_NAMES and not steps:
            return Field(*SHORT_NAMES[word.lower()], begin)
        if not self._resource(word):
            self.kind, self.word, self._begin = kind, word + steps, begin
            raise self.error(f"a resource path such as power/battery, or one of {', '.join(SHORT_NAMES)}")
        return Field(word, steps.removeprefix("."), begin)

    def _age(self) -> Age:
        path, begin = self.word, self._begin
        if self._own and self._take(TokenKind.SYMBOL, ")"):
            return Age(self._own, begin)
        if self.kind is not TokenKind.PATH or not self._resource(path):
            raise self.error("a resource path")
        if self._steps:
            raise self.error(f"a resource path without a field: its fields are as old as {path}")
        self._advance()
        self._close()
        return Age(path, begin)

    @staticmethod
    def _resource(path: str) -> bool:
        return "/" in path.removeprefix("/") and path == path.lower()


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
        if decisive in (left_truth, right_truth):
            return decisive
        return None if left_truth is None or right_truth is None else not decisive
    value = _operand_value(node, lookup)
    return value if isinstance(value, bool) else None
