"""Constructors have at most eight parameters: what belongs together is passed as one object."""

import ast
from typing import Final

import pytest
from tests.architecture.sources import ROOT, parsed

LIMIT: Final = 8


@pytest.mark.parametrize("root", ["lib", "daemons", "cli"])
def test_a_constructor_takes_eight_parameters_at_most(root: str) -> None:
    longer = [
        f"{path.relative_to(ROOT)}:{method.lineno} {node.name}"
        for path in sorted((ROOT / root).rglob("*.py"))
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ClassDef)
        for method in node.body
        if isinstance(method, ast.FunctionDef) and method.name == "__init__"
        if len([*method.args.posonlyargs, *method.args.args, *method.args.kwonlyargs]) > LIMIT + 1
    ]
    assert longer == []
