"""Conditions on resource values: `battery < 80 % or age(nav/pose) > 1`.

Grammar: or, and, not, comparisons (< <= > >= == !=), parentheses; operands are numbers (with % as a
hundredth), 'text', true, false, resource paths with an optional field, age(path) in seconds.
"""

import operator
import re
from collections.abc import Callable
from enum import StrEnum
from typing import Final, Protocol

import msgspec

from swarmware.errors import MissionError

Scalar = bool | float | str
"""Type of the values that a condition compares."""

SHORT_NAMES: Final = {
    "battery": "power/battery.remaining_ratio",
    "batterylevel": "power/battery.remaining_ratio",
    "altitude": "nav/pose.z_m",
}
"""Short names for resources that every vehicle has."""

LENGTH_LIMIT: Final = 500
"""Maximum characters of one condition."""
DEPTH_LIMIT: Final = 20
"""Maximum nesting of parentheses and `not`."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)(?P<percent>\s*%)?"
    r"|'(?P<text>[^']*)'"
    r"|(?P<path>/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*(?:\.[A-Za-z0-9_]+)*)"
    r"|(?P<symbol><=|>=|==|!=|<|>|\(|\)))"
)

_COMPARE: Final[dict[str, Callable[[float | str, float | str], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


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


Operand = Literal | Field | Age
Node = Compare | Not | Both | Either | Literal | Field | Age


class ConditionExpression(msgspec.Struct, frozen=True):
    """A parsed condition with its text."""

    text: str
    node: Node

    def holds(self, lookup: Lookup) -> bool | None:
        """Whether the condition holds now; None when a needed value is missing (Kleene's logic)."""
        return _truth(self.node, lookup)

    def resources(self) -> frozenset[str]:
        """Paths of the resources in the condition."""
        return frozenset(_paths(self.node))


def parse(text: str) -> ConditionExpression:
    """Parse the text of a condition.

    Raises: MissionError with the place in the text and what was expected.
    """
    if len(text) > LENGTH_LIMIT:
        raise MissionError(f"condition of {len(text)} characters: expected at most {LENGTH_LIMIT}")
    reader = _ConditionParser(text)
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

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self.kind = TokenKind.OTHER
        self.word = ""
        self._number = 0.0
        self._percent = False
        self._begin = 0
        self._advance()

    def error(self, expected: str) -> MissionError:
        place = f"at {self.word!r}" if self.kind is not TokenKind.END else "at its end"
        return MissionError(f"condition {self._text!r} {place}: expected {expected}")

    def _advance(self) -> None:
        rest = self._text[self._at :]
        if not rest.strip():
            self.kind, self.word = TokenKind.END, ""
            return
        found = _TOKEN.match(self._text, self._at)
        if found is None:
            self.kind, self.word = TokenKind.OTHER, rest.strip()[:10]
            raise self.error("a number, a resource path, 'text' or a comparison")
        self._at = found.end()
        self._begin = found.start() + len(found[0]) - len(found[0].lstrip())
        self.kind = TokenKind.NUMBER if found["number"] is not None else TokenKind(found.lastgroup or "")
        if self.kind is TokenKind.NUMBER:
            self.word = found[0].strip()
            self._percent = found["percent"] is not None
            self._number = float(found["number"]) / (100.0 if self._percent else 1.0)
        else:
            self.word = found[self.kind]

    def _take(self, kind: TokenKind, word: str) -> bool:
        if self.kind == kind and self.word == word:
            self._advance()
            return True
        return False

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
            if not self._take(TokenKind.SYMBOL, ")"):
                raise self.error(")")
            return node
        left = self._operand()
        if self.kind is TokenKind.SYMBOL and self.word in _COMPARE:
            symbol = self.word
            self._advance()
            return Compare(symbol, left, self._operand())
        if isinstance(left, Literal) and not isinstance(left.value, bool):
            raise self.error("a comparison")
        return left

    def _operand(self) -> Operand:
        kind, word, number, percent, begin = self.kind, self.word, self._number, self._percent, self._begin
        is_value = kind in {TokenKind.NUMBER, TokenKind.TEXT, TokenKind.PATH}
        if not is_value or (kind is TokenKind.PATH and word in {"and", "or", "not"}):
            raise self.error("a number, a resource path or 'text'")
        self._advance()
        if kind is TokenKind.NUMBER:
            return Literal(number, percent)
        if kind is TokenKind.TEXT:
            return Literal(word)
        if word in {"true", "false"}:
            return Literal(word == "true")
        if word == "age" and self._take(TokenKind.SYMBOL, "("):
            path, begin = self.word, self._begin
            if self.kind is not TokenKind.PATH or not self._resource(path):
                raise self.error("a resource path")
            self._advance()
            if not self._take(TokenKind.SYMBOL, ")"):
                raise self.error(")")
            return Age(path, begin)
        full = SHORT_NAMES.get(word.lower(), word)
        path, _, field = full.partition(".")
        if not self._resource(path):
            self.kind, self.word = kind, word
            raise self.error(f"a resource path such as power/battery, or one of {', '.join(SHORT_NAMES)}")
        return Field(path, field, begin)

    @staticmethod
    def _resource(path: str) -> bool:
        return "/" in path.removeprefix("/") and path == path.lower()


def _operand_value(node: Operand, lookup: Lookup) -> Scalar | None:
    if isinstance(node, Literal):
        return node.value
    if isinstance(node, Age):
        return lookup.age_s(node.path)
    return lookup.value(node.path, node.field)


def _truth(node: Node, lookup: Lookup) -> bool | None:
    if isinstance(node, Compare):
        left, right = _operand_value(node.left, lookup), _operand_value(node.right, lookup)
        if left is None or right is None or isinstance(left, str) != isinstance(right, str):
            return None
        return _COMPARE[node.symbol](left, right)
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


def _paths(node: Node) -> set[str]:
    if isinstance(node, Field | Age):
        return {node.path}
    if isinstance(node, Not):
        return _paths(node.inner)
    if isinstance(node, Both | Either | Compare):
        return _paths(node.left) | _paths(node.right)
    return set()
