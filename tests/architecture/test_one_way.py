"""One way to do each thing: what has a place of its own in the library is not written again elsewhere.

Names that a linter can ban are in pyproject.toml.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from tests.architecture.sources import parsed, walked

ROOT: Final = Path(__file__).parents[2]
TREES: Final = {
    str(path.relative_to(ROOT)): parsed(path)
    for folder in ("lib", "daemons", "cli")
    for path in sorted((ROOT / folder).rglob("*.py"))
}

CALLS: Final = {
    "replace a file": (
        {"os.replace", "os.rename", "os.renames", "*.rename", "path.replace", "fresh.replace"},
        {
            "lib/swarmware/runtime/filewriter.py": "the writer of files",
            "lib/swarmware/transport/shm/ringfile.py": "a ring gets its name when it is filled",
            "lib/swarmware/transport/shm/shared_file.py": "sets a folder aside that is in the way of a file",
            "lib/swarmware/transport/appfile/trace.py": "sets the file of a dead application aside",
            "lib/swarmware/recorder/growing_file.py": "a segment gets its name when it has its end",
            "lib/swarmware/recorder/ring.py": "sets a damaged segment aside",
            "cli/swarmctl/commands/log/tables.py": "a table gets its name at its end",
        },
    ),
    "read a ring": (
        {"RingReader"},
        {
            "lib/swarmware/transport/shm/ring.py": "the reader itself reopens",
            "lib/swarmware/node/follower.py": "the follower of rings",
            "cli/swarmctl/commands/doctor/broker_checks.py": "reads once, without the node",
        },
    ),
}
"""What is done in one place: the calls, and the files that make them, each with its reason."""


def calls(tree: ast.Module) -> Iterator[str]:
    """Each called name, such as `os.replace`."""
    for node in walked(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func)


def matches(name: str, wanted: set[str]) -> bool:
    """Whether this call is one of those wanted; `*.rename`: of any object."""
    return name in wanted or f"*.{name.rpartition('.')[2]}" in wanted


@pytest.mark.parametrize("what", CALLS)
def test_it_is_done_in_one_place(what: str) -> None:
    wanted, places = CALLS[what]
    found = {path for path, tree in TREES.items() if any(matches(name, wanted) for name in calls(tree))}
    assert found == set(places), f"to {what}: use the one place, or give a reason here"


def is_own_backoff(node: ast.AST) -> bool:
    """Whether this is `pauses[min(failures, len(pauses) - 1)]`, or `min(2 * pause, limit)`."""
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Call | ast.BinOp):
        return "min(" in ast.unparse(node.slice) and "len(" in ast.unparse(node.slice)
    if not (isinstance(node, ast.Call) and ast.unparse(node.func) == "min"):
        return False
    return any(
        isinstance(side, ast.BinOp) and isinstance(side.op, ast.Mult | ast.Pow) and number in {"2", "2.0"}
        for side in node.args
        if isinstance(side, ast.BinOp)
        for number in (ast.unparse(side.left), ast.unparse(side.right))
    )


BACKOFF: Final = {
    "lib/swarmware/runtime/backoff.py": "the rule of a back-off",
    "daemons/swarmd/logger/log_forwarder.py": "the size of a batch, which grows with success",
    "lib/swarmware/transport/delivery/outbox.py": "a time-out that begins with the round trip",
}


def test_there_is_one_back_off() -> None:
    found = {path for path, tree in TREES.items() if any(is_own_backoff(node) for node in walked(tree))}
    assert found == set(BACKOFF), "expected swarmware.runtime.backoff.pause_after, or a reason here"
