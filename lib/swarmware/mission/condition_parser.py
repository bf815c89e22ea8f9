"""The text of conditions on resource values: `battery < 80 % or age(nav/pose) > 1`.

Grammar: or, and, not, comparisons (< <= > >= == !=), parentheses, absent(path.field); operands are numbers
(with % as a hundredth), 'text' or "text", true, false, resource paths with an optional field, age(path) in
seconds. A field is a name, or an element of a map or list: `health/state.sensors["sensor/gnss"]`, `[0]`; the
end of a path names an element of a map as well, and a truth value may be compared with the words valid and
invalid: `health/state.sensors.gnss == "valid"`.
In a condition on one resource names without a path are its fields, and age() is its age.
"""

import re
from enum import StrEnum
from typing import Final

from swarmware.errors import MissionError
from swarmware.mission.condition import (
    COMPARISONS,
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
from swarmware.mission.field_path import STEPS_PATTERN

SHORT_NAMES: Final = {
    "battery": ("power/battery", "remaining_ratio"),
    "batterylevel": ("power/battery", "remaining_ratio"),
    "altitude": ("nav/pose", "z_m"),
}
"""Short names for resources that every vehicle has."""

LENGTH_LIMIT: Final = 500
"""Maximum characters of one condition."""
DEPTH_LIMIT: Final = 20
"""Maximum nesting of parentheses and `not`."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)(?P<percent>\s*%)?"
    r"|'(?P<text>[^']*)'|\"(?P<quoted>[^\"]*)\""
    rf"|(?P<path>/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*)(?P<steps>{STEPS_PATTERN})"
    r"|(?P<symbol><=|>=|==|!=|<|>|\(|\)))"
)


def parse(text: str, own: str = "") -> ConditionExpression:
    """Parse the text of a condition.

    `own`: path of the resource whose fields are named without a path, or "" if such names are short names.
    Raises: MissionError with the place in the text and the expected value.
    """
    if len(text) > LENGTH_LIMIT:
        raise MissionError(f"condition of {len(text)} characters: expected at most {LENGTH_LIMIT}")
    reader = _ConditionParser(text, own)
    node = reader.either(0)
    # the grammar ended before the text
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
            # behind a path the bracket shows what the author meant
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
        # with a field behind it, `or.x` is a path, not the operator
        if self.kind == kind and self.word == word and not self._steps:
            self._advance()
            return True
        return False

    def _take_call(self, name: str) -> bool:
        """Takes the name of a function and its opening parenthesis."""
        called = self.kind is TokenKind.PATH and self.word == name and not self._steps
        # a resource may have the name of a function; the parenthesis decides
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
        # the text comes from a file: its nesting must not exhaust the stack
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
        # a number or text alone is neither true nor false
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
        # before the short names: in a condition on one resource its own fields take precedence
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
        # one segment would be a misspelt short name; paths have no capital letters
        return "/" in path.removeprefix("/") and path == path.lower()
