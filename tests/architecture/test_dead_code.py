"""What only tests use is gone: each name that lib, daemons or cli define is used there, or documented."""

import ast
import re
from collections import Counter
from collections.abc import Iterator

from tests.architecture.sources import ROOT, parsed, trees, walked

PAGES = (*(ROOT / "share").glob("doc/*.md"), ROOT / "README.md", ROOT / "pyproject.toml")
EXAMPLES = [*(ROOT / "share").rglob("*.py")]
OVERRIDES = {
    "Driver": "what packages of version 0.1 call a Sensor",
    "SSLContext": "read by asyncio",
    **dict.fromkeys(("connection_made", "connection_lost", "data_received"), "called by asyncio"),
    "format_commands": "called by click",
    "format_options": "called by click",
    "_missing_": "called by enum",
    "next_view": "large frames are read in place: `make bench` measures it",
}
"""Names that are used from outside; each with its user."""
TESTING = "swarmware/testing"
"""Is for tests."""

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def is_registered(node: Definition) -> bool:
    """Whether a decorator or a base takes the definition: commands of click, registered types."""
    return any(
        re.search(r"command|group|register|plugin|pass_", ast.unparse(decorator))
        for decorator in node.decorator_list
    )


def definitions(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Functions, methods, classes and constants of a module, but for special names."""
    for node in walked(tree):
        if isinstance(node, Definition) and not is_registered(node) and not node.name.startswith("__"):
            yield node.name, node.lineno
    for statement in tree.body:
        match statement:
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                if not name.startswith("__"):
                    yield name, statement.lineno


def uses(tree: ast.AST) -> Iterator[str]:
    """Names that code reads; an import alone is no use, nor is the definition."""
    for node in walked(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name):
                yield name
            case ast.keyword(arg=str(name)):
                yield name
            case ast.Constant(value=str(text)) if re.fullmatch(r"([\w.]+:)?\w+", text):
                yield text.rpartition(":")[2]  # getattr, a forward reference, a name in a table


def documented() -> set[str]:
    """Words in code quotes of the pages, entry points, and names that the examples use."""
    words: set[str] = set()
    for page in PAGES:
        text = page.read_text()
        quoted = text if page.suffix == ".toml" else "\n".join(re.findall(r"```.*?```|`[^`\n]+`", text, re.S))
        words.update(re.findall(r"[A-Za-z_]\w*", quoted))
    for example in EXAMPLES:
        words.update(uses(parsed(example)))
    return words


def test_definition_of_the_product_is_used_or_documented() -> None:
    used = Counter(name for tree in trees().values() for name in uses(tree))
    known = documented()
    dead = {
        name: f"{path}:{line}: {name}"
        for path, tree in trees().items()
        if TESTING not in path
        for name, line in definitions(tree)
        if not used[name] and name not in known
    }
    new = [place for name, place in dead.items() if name not in OVERRIDES]
    assert not new, "\n".join(["used by tests only, or by nothing; remove it:", *new])
    assert sorted(OVERRIDES.keys() - dead.keys()) == [], "an exception is no longer needed"
