"""`async` is only what waits: a function that never does returns at once."""

import ast
from collections.abc import Iterator

from tests.architecture.sources import Function, last_word, trees, walked

WAITING = {
    "Service": {"run", "stop"},  # a service may wait as it stops, ours or a user's
    "Device": {"open", "close"},  # a device may be slow
    "Sensor": {"open", "read", "close"},
    "Actuator": {"open", "write", "close"},
    "FunctionalBlock": {"run"},  # the step of a mission
    "BlockVehicle": {"goto"},  # a movement
    "FakeClient": {"send"},  # the interface of the client that it stands for
}
"""Methods that users or other implementations make wait: class → methods, also in what is derived from it."""


def own(body: list[ast.stmt]) -> Iterator[ast.AST]:
    """Nodes of a function, without the functions and classes that it defines."""
    todo: list[ast.AST] = list(body)
    while todo:
        node = todo.pop()
        yield node
        if not isinstance(node, Function | ast.Lambda | ast.ClassDef):
            todo += ast.iter_child_nodes(node)


def waits(function: ast.AsyncFunctionDef) -> bool:
    return any(
        isinstance(node, ast.Await | ast.AsyncFor | ast.AsyncWith | ast.Yield)
        or (isinstance(node, ast.comprehension) and node.is_async)
        for node in own(function.body)
    )


def idle(tree: ast.AST, bases: dict[str, set[str]]) -> Iterator[tuple[int, str]]:
    """Line and name of each `async def` that never waits."""
    for node in walked(tree):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.AsyncFunctionDef) and not waits(child):
                kin = ancestors(node.name, bases) if isinstance(node, ast.ClassDef) else set()
                if not any(child.name in WAITING.get(name, ()) for name in kin):
                    yield child.lineno, child.name


def ancestors(name: str, bases: dict[str, set[str]]) -> set[str]:
    return {name}.union(*(ancestors(base, bases) for base in bases.get(name, ())))


def bases_of(trees: list[ast.Module]) -> dict[str, set[str]]:
    """Bases of each class name; classes that share a name, as in the scaffolds, share their bases too."""
    found: dict[str, set[str]] = {}
    for node in (node for tree in trees for node in walked(tree) if isinstance(node, ast.ClassDef)):
        found.setdefault(node.name, set()).update({last_word(base) for base in node.bases} - {node.name})
    return found


def test_what_never_waits_is_not_async() -> None:
    sources = trees("lib", "daemons", "cli", "share")
    bases = bases_of(list(sources.values()))
    found = [f"{path}:{line} {name}" for path, tree in sources.items() for line, name in idle(tree, bases)]
    assert not found, "no await, async for, async with or yield in:\n" + "\n".join(found)


def test_rule_sees_what_waits_and_what_does_not() -> None:
    text = """
class Slow(Sensor[int]):
    async def read(self): return 1
    async def list(self): return [x async for x in self]
class Other:
    async def read(self): return 1
    async def outer(self):
        async def inner(): await self.read()
        return inner
    async def items(self): yield 1
"""
    tree = ast.parse(text)
    assert set(idle(tree, bases_of([tree]))) == {(6, "read"), (7, "outer")}
