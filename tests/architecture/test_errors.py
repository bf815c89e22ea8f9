"""Every error that our code raises on purpose is a SwarmError; builtin ones are left to Python."""

import ast
import builtins
import re

from tests.architecture.sources import ROOT, trees, walked

PROTOCOL = {
    "AttributeError",  # of `__getattr__`
    "IndexError",  # of a container
    "OSError",  # of a system call that `os` does not have
    "KeyboardInterrupt",  # handed on
    "ProcessLookupError",  # of a handle, as the kernel raises it for a process that has ended
    "SystemExit",
    "TypeError",  # a mistake in our own table of commands
}
"""What Python expects at its own protocols."""


def test_no_builtin_error_is_raised_on_purpose() -> None:
    found = [
        f"{path}:{node.lineno} {name}; expected a SwarmError"
        for path, tree in trees().items()
        for node in walked(tree)
        if isinstance(node, ast.Raise) and node.exc is not None
        for name in [ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)]
        if hasattr(builtins, name) and name not in PROTOCOL
    ]
    assert not found, "\n".join(found)


BROAD = {"Exception", "BaseException", "OSError", "EnvironmentError"}
"""Errors of many causes, so an unexpected cause would vanish with them."""


def test_no_error_of_many_causes_vanishes_without_reason() -> None:
    found = []
    for path, tree in trees().items():
        lines = (ROOT / path).read_text("utf-8").splitlines()
        for node in walked(tree):
            match node:
                case ast.ExceptHandler(type=kind, body=body):
                    caught = "BaseException" if kind is None else ast.unparse(kind)
                    silent = all(_is_silent(statement) for statement in body)
                case ast.withitem(context_expr=ast.Call(func=func, args=args)):
                    silent = ast.unparse(func).endswith("suppress")
                    caught = ", ".join(map(ast.unparse, args))
                case _:
                    continue
            if not silent or not BROAD & set(re.findall(r"\w+", caught)):
                continue
            at = node.context_expr if isinstance(node, ast.withitem) else node
            first, last = at.lineno - 2, (at.end_lineno or at.lineno) + 1
            if not any("#" in line for line in lines[first:last]):
                found.append(f"{path}:{at.lineno} {caught}")
    assert not found, "expected a log, a count, a raise, or a comment with the reason:\n" + "\n".join(found)


def _is_silent(statement: ast.stmt) -> bool:
    """Whether the statement ignores the error: pass, continue, or a return of a constant."""
    match statement:
        case ast.Pass() | ast.Continue() | ast.Break():
            return True
        case ast.Return(value=None | ast.Constant()):
            return True
    return False
