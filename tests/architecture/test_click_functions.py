"""A click function reads options and makes one call; the logic is a function that a test can call."""

import ast
from pathlib import Path

import pytest
from tests.architecture.sources import parsed, walked

ROOT = Path(__file__).parents[2]
NESTED = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)
LOGIC = (*NESTED, ast.Await, ast.For, ast.AsyncFor, ast.While, ast.Try, ast.With, ast.comprehension)


def click_functions(path: Path) -> list[ast.FunctionDef]:
    tree = parsed(path)
    return [
        node
        for node in walked(tree)
        if isinstance(node, ast.FunctionDef)
        and any(
            ast.unparse(decorator).partition("(")[0].endswith(".command") for decorator in node.decorator_list
        )
    ]


FUNCTIONS = {
    f"{path.relative_to(ROOT / 'cli')}:{function.name}": function
    for path in sorted((ROOT / "cli").rglob("*.py"))
    for function in click_functions(path)
}


def test_the_commands_are_found() -> None:
    assert len(FUNCTIONS) > 40


@pytest.mark.parametrize("name", FUNCTIONS)
def test_click_function_has_no_logic_of_its_own(name: str) -> None:
    inside = [node for statement in FUNCTIONS[name].body for node in ast.walk(statement)]
    assert [ast.unparse(node) for node in inside if isinstance(node, LOGIC)] == []


@pytest.mark.parametrize(
    "folder", sorted(path.parent.name for path in (ROOT / "cli/swarmctl/commands").glob("*/command.py"))
)
def test_options_of_group_share_file_without_click_logic(folder: str) -> None:
    for path in (ROOT / "cli/swarmctl/commands" / folder).glob("*.py"):
        if path.name != "command.py":
            assert click_functions(path) == [], f"{path}: expected its options in command.py"
