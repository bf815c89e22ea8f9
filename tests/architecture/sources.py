"""The sources of the project, each parsed once for all tests of a process."""

import ast
import gc
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
ROOTS: Final = ("lib", "daemons", "cli")
CONTRACTS: Final = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
Function = ast.FunctionDef | ast.AsyncFunctionDef


def last_word(node: ast.expr) -> str:
    """`Sensor` of `hal.Sensor[int]`."""
    return ast.unparse(node).partition("[")[0].rpartition(".")[2]


@cache
def parsed(path: Path) -> ast.Module:
    """Syntax tree of a file; shared, so not to be changed."""
    text = path.read_text("utf-8")
    collects = gc.isenabled()
    gc.disable()  # every node lives on: collections between them only take time
    try:
        return ast.parse(text)
    finally:
        gc.freeze()  # and no later collection traverses them
        if collects:
            gc.enable()


@cache
def walked(tree: ast.Module) -> tuple[ast.AST, ...]:
    """All nodes of a tree that `parsed` gave, as `ast.walk` gives them."""
    return tuple(ast.walk(tree))


def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file."""
    return walked(parsed(path))


@cache
def trees(*roots: str) -> dict[str, ast.Module]:
    """Syntax trees of the modules below these folders, by path; of lib, daemons and cli without any."""
    paths = (path for root in roots or ROOTS for path in sorted((ROOT / root).rglob("*.py")))
    return {str(path.relative_to(ROOT)): parsed(path) for path in paths}


@cache
def files() -> dict[str, Path]:
    """The file of each module, and of each package its `__init__.py`."""
    found = {}
    for root in ROOTS:
        for path in sorted((ROOT / root).rglob("*.py")):
            parts = path.relative_to(ROOT / root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports() -> dict[str, set[str]]:
    """Modules of this project that each of its modules imports, anywhere in the file."""
    return {name: set(_imported(path)) for name, path in files().items()}


def _imported(path: Path) -> Iterator[str]:
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in files())
        elif isinstance(node, ast.ImportFrom) and node.module in files():
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in files() else node.module
