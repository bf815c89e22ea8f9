"""The names and paths that are kept for the daemons are those of the installed daemons."""

import ast
from pathlib import Path

from swarmware.model.reserved import APPLICATIONS, is_reserved_path
from swarmware.service.installed import installed

ROOT = Path(__file__).parents[2]
SERVING = {"serve", "inbox", "take_datagrams"}


def test_the_name_of_each_daemon_is_kept() -> None:
    daemons = {name for name, point in installed().items() if point.value.startswith("swarmd.")}
    assert daemons == APPLICATIONS


def served_literals() -> dict[str, str]:
    """Paths that daemons serve, as far as they stand in the call, and where."""
    found = {}
    for file in sorted((ROOT / "daemons").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
                continue
            path = node.args[0]
            if node.func.attr in SERVING and isinstance(path, ast.Constant) and "/" in str(path.value):
                found[str(path.value)] = f"{file.relative_to(ROOT)}:{node.lineno}"
    return found


def test_daemons_serve_below_the_kept_branches_only() -> None:
    found = served_literals()
    assert len(found) > 20
    assert {path: place for path, place in found.items() if not is_reserved_path(path)} == {}
