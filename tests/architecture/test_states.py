"""No control flow from prose: a state is compared with a member, a text for people is never taken apart.

A field with a `Literal` type may be compared with its words, which the type checker knows; a field with a
vocabulary on the wire is an `OpenEnum` (ADR 26).
"""

import ast
import re
from collections.abc import Iterator
from typing import Final

from tests.architecture.sources import trees, walked

TREES: Final = trees()
STATES: Final = {
    *("cause", "change", "event", "fault", "kind", "level", "link_state", "mode", "mongodb", "outcome"),
    *("phase", "quality", "reason", "result", "role", "severity", "state", "status", "successor"),
    *("transport", "type", "verb", "verdict", "why"),
}
"""Names of fields with states, kinds and outcomes."""
PROSE: Final = STATES | {"detail", "error", "label", "message", "note", "text", "words"}
WORD: Final = re.compile(r"[A-Za-z][\w -]*")
TAKEN_APART: Final = frozenset(
    ["endswith", "partition", "removeprefix", "removesuffix", "rpartition", "split", "startswith"]
)


def words(node: ast.AST) -> frozenset[str]:
    """The words among these literals."""
    parts = node.elts if isinstance(node, ast.Tuple | ast.Set | ast.List) else [node]
    return frozenset(
        part.value
        for part in parts
        if isinstance(part, ast.Constant) and isinstance(part.value, str) and WORD.fullmatch(part.value)
    )


def literals(node: ast.AST, aliases: dict[str, frozenset[str]]) -> frozenset[str]:
    """Words that an annotation permits, or an empty set if it is not a `Literal`."""
    found: frozenset[str] = frozenset()
    for part in ast.walk(node):
        if isinstance(part, ast.Subscript) and ast.unparse(part.value).endswith("Literal"):
            found |= words(part.slice)
        elif isinstance(part, ast.Name):
            found |= aliases.get(part.id, frozenset())
    return found


def checked() -> dict[str, frozenset[str]]:
    """Words of the fields, arguments and functions with a `Literal` type, by name."""
    aliases = {
        node.targets[0].id: literals(node.value, {})
        for tree in TREES.values()
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    found: dict[str, frozenset[str]] = {}
    for tree in TREES.values():
        for node in walked(tree):
            if isinstance(node, ast.AnnAssign):
                name, kind = last_name(node.target), node.annotation
            elif isinstance(node, ast.arg) and node.annotation is not None:
                name, kind = node.arg, node.annotation
            else:
                continue
            found[name] = found.get(name, frozenset()) | literals(kind, aliases)
    return found


def last_name(node: ast.AST) -> str:
    """`state` of `self.module.state`, of `state`, and of `str(seen.state)`."""
    if isinstance(node, ast.Call) and len(node.args) == 1 and ast.unparse(node.func) == "str":
        return last_name(node.args[0])
    if isinstance(node, ast.Attribute):
        return node.attr.lstrip("_")
    return node.id.lstrip("_") if isinstance(node, ast.Name) else ""


def compared(tree: ast.Module, known: dict[str, frozenset[str]]) -> Iterator[tuple[int, str]]:
    """Comparisons of a state with a word that no type checker knows."""
    for node in walked(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            named = {name for side in sides if (name := last_name(side)) in STATES}
            for name in named:
                if any(words(side) - known.get(name, frozenset()) for side in sides):
                    yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Match) and (name := last_name(node.subject)) in STATES:
            for case in node.cases:
                for part in ast.walk(case.pattern):
                    if isinstance(part, ast.MatchValue) and words(part.value) - known.get(name, frozenset()):
                        yield part.lineno, f"match {name}: case {ast.unparse(part.value)}"


def taken_apart(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Questions to the text of a state or of a message: `startswith`, `"away" in state`."""
    for node in walked(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr=verb, value=asked)) if verb in TAKEN_APART:
                pass
            case ast.Compare(
                left=ast.Constant() | ast.JoinedStr(), ops=[ast.In() | ast.NotIn()], comparators=[asked]
            ):
                pass
            case _:
                continue
        if is_prose(asked):
            yield node.lineno, ast.unparse(node)


def is_prose(node: ast.AST) -> bool:
    """A state anywhere, and a text that is a field: a variable of this name may be input to be parsed."""
    name = last_name(node)
    return name in (PROSE if isinstance(node, ast.Attribute) else STATES)


def test_state_is_compared_with_member_not_with_text() -> None:
    known = checked()
    found = [
        f"{path}:{line} {text}"
        for path, tree in TREES.items()
        for line, text in (*compared(tree, known), *taken_apart(tree))
    ]
    assert not found, "expected a member of an enumeration:\n" + "\n".join(sorted(found))
