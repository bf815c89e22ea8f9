"""The sources of the project, each parsed once for all tests of a process."""

import ast
import gc
from functools import cache
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]


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
