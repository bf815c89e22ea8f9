"""An object is whole when its constructor returns: no other method makes a new attribute."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field

from tests.architecture.sources import Function, last_word, trees, walked


@dataclass
class ClassFacts:
    """What is known of one class by its text."""

    where: str
    bases: list[str]
    made: set[str] = field(default_factory=set)
    """Attributes that its constructor or its body makes."""
    later: dict[str, int] = field(default_factory=dict)
    """Attribute → first line at which another method assigns it."""


def targets(node: ast.AST) -> list[ast.expr]:
    match node:
        case ast.Assign():
            return node.targets
        case ast.AnnAssign() if node.value is not None:
            return [node.target]
        case ast.For() | ast.AsyncFor():
            return [node.target]
        case ast.withitem() if node.optional_vars is not None:
            return [node.optional_vars]
    return []


def assigned(function: Function) -> Iterator[tuple[str, int]]:
    """Attributes of the first argument that a method assigns."""
    if not function.args.args:
        return
    me = function.args.args[0].arg
    for node in ast.walk(function):
        for target in targets(node):
            for part in ast.walk(target):
                if (
                    isinstance(part, ast.Attribute)
                    and isinstance(part.ctx, ast.Store)
                    and isinstance(part.value, ast.Name)
                    and part.value.id == me
                ):
                    yield part.attr, part.lineno


def constructing(node: ast.ClassDef) -> Iterator[Function]:
    """The constructor and the methods of the object that it calls, directly or through each other."""
    methods = {item.name: item for item in node.body if isinstance(item, Function)}
    todo, seen = ["__init__", "__post_init__"], set[str]()
    while todo:
        name = todo.pop()
        if name in seen or name not in methods:
            continue
        seen.add(name)
        yield methods[name]
        todo += [
            call.func.attr
            for call in ast.walk(methods[name])
            if isinstance(call, ast.Call)
            and isinstance(call.func, ast.Attribute)
            and ast.unparse(call.func.value) == "self"
        ]


def facts(node: ast.ClassDef, where: str) -> ClassFacts:
    found = ClassFacts(where, [last_word(base) for base in node.bases])
    found.made |= {name for method in constructing(node) for name, _ in assigned(method)}
    fields = any("dataclass" in ast.unparse(one) for one in node.decorator_list)
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and (item.value is not None or fields):
            found.made.add(ast.unparse(item.target))
        elif isinstance(item, ast.Assign):
            found.made |= {ast.unparse(target) for target in item.targets}
        elif isinstance(item, Function) and any(
            ast.unparse(one).endswith(".setter") for one in item.decorator_list
        ):
            found.made.add(item.name)
    for item in node.body:
        static = isinstance(item, Function) and any(
            ast.unparse(one) in {"staticmethod", "classmethod"} for one in item.decorator_list
        )
        if isinstance(item, Function) and not static:
            for name, line in assigned(item):
                found.later.setdefault(name, line)
    return found


def classes(sources: dict[str, ast.Module]) -> dict[str, list[ClassFacts]]:
    out: dict[str, list[ClassFacts]] = {}
    for where, tree in sources.items():
        for node in walked(tree):
            if isinstance(node, ast.ClassDef):
                out.setdefault(node.name, []).append(facts(node, where))
    return out


def made(one: ClassFacts, known: dict[str, list[ClassFacts]], seen: frozenset[str] = frozenset()) -> set[str]:
    inherited = [
        made(kin, known, seen | {base})
        for base in one.bases
        if base not in seen
        for kin in known.get(base, ())
    ]
    return one.made.union(*inherited)


def late(sources: dict[str, ast.Module]) -> dict[str, list[str]]:
    """`path:Class` → attributes that no constructor makes, with their lines."""
    known = classes(sources)
    found: dict[str, list[str]] = {}
    for name, same in sorted(known.items()):
        for one in same:
            early = made(one, known)
            rest = [f"{attr} (line {line})" for attr, line in one.later.items() if attr not in early]
            if rest:
                found[f"{one.where}:{name}"] = rest
    return found


def test_no_method_but_the_constructor_makes_an_attribute() -> None:
    found = [f"{where}: {', '.join(names)}; expected in __init__" for where, names in late(trees()).items()]
    assert not found, "\n".join(found)


def test_nothing_looks_whether_it_has_an_attribute() -> None:
    found = [
        f"{where}:{node.lineno} {ast.unparse(node)}"
        for where, tree in trees().items()
        for node in walked(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in {"getattr", "hasattr"}
        and ast.unparse(node.args[0]) == "self"
        and isinstance(node.args[1], ast.Constant)
    ]
    assert not found, "\n".join(found)


def test_the_rule_sees_what_is_made_late() -> None:
    text = """
class Whole:
    limit: int = 3
    def __init__(self):
        self.a, self.b = 1, 2
        self._first()
    def _first(self): self._second()
    def _second(self): self.f = 0
    def run(self): self.a = self.limit = 4
class Late(Whole):
    def __init__(self):
        super().__init__()
        self.c: int
    def run(self):
        self.b, self.c = 1, 2
        with open("x") as self.d: pass
    async def more(self):
        for self.e in (): pass
"""
    found = late({"x.py": ast.parse(text)})
    assert found == {"x.py:Late": ["c (line 15)", "d (line 16)", "e (line 18)"]}
