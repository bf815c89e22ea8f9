"""Tests per line of code: at least 0.9 lines of tests for each line of lib, daemons and cli."""

import ast
from pathlib import Path

from tests.architecture.sources import parsed, walked

ROOT = Path(__file__).parents[2]
RATIO_MIN = 0.9


def code_lines(path: Path) -> int:
    """Lines on which code begins: no blank lines, comments or docstrings."""
    tree = parsed(path)
    texts = {
        line
        for node in walked(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    begins = {node.lineno for node in walked(tree) if isinstance(node, ast.stmt | ast.expr | ast.arg)}
    return len(begins - texts)


def total(*folders: str) -> int:
    return sum(code_lines(path) for folder in folders for path in (ROOT / folder).rglob("*.py"))


def test_there_are_enough_lines_of_tests_for_the_lines_of_code() -> None:
    ratio = total("tests") / total("lib", "daemons", "cli")
    assert ratio >= RATIO_MIN, f"{ratio:.2f} lines of tests per line of code"
