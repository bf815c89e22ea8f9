"""The parent of a node's processes lives as long as the node: it must stay small."""

import subprocess
import sys
from typing import Final

from swarmd.parent import ENTRY

HEAVY: Final = {
    *("argparse", "asyncio", "collections", "contextlib", "enum", "functools", "logging", "msgspec"),
    *("pathlib", "re", "selectors", "signal", "socket", "struct", "types", "typing", "uvloop", "zmq"),
}
OURS: Final = 22
"""Modules of this repository in the parent of a node of one process; 21 when this was written."""


def loaded(program: str) -> set[str]:
    code = program.replace("sys.exit(main(sys.argv[1:]))", "print(*sys.modules)")
    return set(subprocess.check_output([sys.executable, "-P", "-c", code], text=True).split())


def test_parent_loads_nothing_that_it_does_not_need() -> None:
    found = loaded(ENTRY) - loaded("import sys; print(*sys.modules)")
    assert "swarmd.parent" in found
    assert not HEAVY & found
    assert len([name for name in found if name.startswith("swarm")]) <= OURS
