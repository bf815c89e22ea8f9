"""A test that fails, fails again: what it draws at random comes from a fixed seed."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.architecture.sources import parsed, walked

TESTS: Final = Path(__file__).parents[1]
GENERATORS: Final = {"random.Random", "Random", "np.random.default_rng"}
"""Constructors that need a seed as argument."""
UNSEEDED: Final = {"os.urandom", "uuid.uuid4"}


def unseeded(tree: ast.AST) -> Iterator[str]:
    """Calls whose results differ between two runs."""
    imported = {
        alias.name for node in walked(tree) if isinstance(node, ast.Import) for alias in node.names
    }  # elsewhere `random` is the name of a generator
    for call in (node for node in walked(tree) if isinstance(node, ast.Call)):
        name = ast.unparse(call.func)
        module = name.rpartition(".")[0]
        if name in GENERATORS:
            if not call.args:
                yield ast.unparse(call)
        elif name in UNSEEDED or module in {"np.random", "secrets", *(imported & {"random"})}:
            yield ast.unparse(call)


def test_no_test_draws_without_a_seed() -> None:
    found = {
        f"{path.relative_to(TESTS)}: {call}"
        for path in TESTS.rglob("*.py")
        for call in unseeded(parsed(path))
    }
    assert sorted(found) == []
