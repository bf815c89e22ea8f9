"""Every error that our code raises on purpose is a SwarmError; builtin ones are left to Python."""

import ast
import builtins
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROTOCOL = {
    "AttributeError",  # of `__getattr__`
    "IndexError",  # of a container
    "KeyboardInterrupt",  # handed on
    "ProcessLookupError",  # of a handle, as the kernel raises it for a process that has ended
    "SystemExit",
    "TypeError",  # a mistake in our own table of commands
}
"""What Python expects at its own protocols."""


def test_no_builtin_error_is_raised_on_purpose() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {name}; expected a SwarmError"
        for folder in ("lib", "daemons", "cli")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Raise) and node.exc is not None
        for name in [ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)]
        if hasattr(builtins, name) and name not in PROTOCOL
    ]
    assert not found, "\n".join(found)
